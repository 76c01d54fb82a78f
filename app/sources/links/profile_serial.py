"""A serial line that a profile describes, read in a thread of its own, opened again for ever; it sends requests."""

from collections.abc import Callable

import serial

from app.battery.serial import SerialMapping
from app.clock import Clock
from app.sources.items import Item, SerialBytes
from app.sources.links.serial import POLL_S, SILENCE_S, Backoff, SerialLink, port_reader
from app.sources.links.serial_url import open_port

REPLY_S = 0.1  # for one answer, before the next request


class Requests:
    """Schedule of requests: each frame's every `poll_s`, one after the other."""

    def __init__(self, mapping: SerialMapping) -> None:
        self._all = [(part.poll, part.poll_s) for part in mapping.parts if part.poll]
        self._due_s = [0.0] * len(self._all)
        self._free_s = 0.0

    def next(self, now_s: float) -> bytes:
        """Return the request that is due at a time [s], empty where none is."""
        if not self._all or now_s < self._free_s:
            return b""
        k = min(range(len(self._all)), key=self._due_s.__getitem__)
        if now_s < self._due_s[k]:
            return b""
        poll, every_s = self._all[k]
        self._due_s[k] = max(self._due_s[k] + every_s, now_s + 0.5 * every_s)
        self._free_s = now_s + REPLY_S
        return poll


class ProfileSerialLink(SerialLink):
    """Gives what it reads to `sink`, from its own thread."""

    def __init__(
        self,
        url: str,
        mapping: SerialMapping,
        sink: Callable[[Item], None],
        clock: Clock,
        backoff: Backoff | None = None,
    ) -> None:
        super().__init__(url, sink, clock, backoff)
        self._mapping = mapping

    def stream(self, *, on: bool) -> None:
        """Send what starts or stops the stream, where the profile has that.

        Raises:
            LinkLost: the port is not open, or closed while writing.
        """
        self.streams = on
        data = self._mapping.port.start if on else self._mapping.port.stop
        if data:
            self.write(data)

    def _open(self) -> serial.Serial:
        return open_port(self.url, POLL_S, self._mapping.port)

    def _read_until_lost(self, port: serial.Serial, on_data: Callable[[], None]) -> None:
        read = port_reader(port, self._clock)
        requests = Requests(self._mapping)
        silent_since_s = self._clock.monotonic_s()
        self.stream(on=self.streams)
        while not self._stopping.is_set():
            if self.streams and (request := requests.next(self._clock.monotonic_s())):
                self.write(request)
            data, _ = read()
            now_ns = self.beat_ns = self._clock.monotonic_ns()
            if data:
                on_data()
                self._sink(SerialBytes(now_ns, self._clock.wall_ns(), data))
                silent_since_s = now_ns / 1e9
            elif self.streams and now_ns / 1e9 - silent_since_s > SILENCE_S:
                silent_since_s = now_ns / 1e9
                self.stream(on=True)
