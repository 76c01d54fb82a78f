"""The RS232 link, read in a thread of its own, opened again for ever.

`x` is sent on opening and after every second of silence, so that a master that was reset streams again.
"""

import contextlib
import os
import random
import select
import threading
from collections.abc import Callable
from dataclasses import dataclass, field

import serial

from app.clock import Clock
from app.errors import LinkLost, message_of
from app.sources.items import Item, LinkChange, SerialItem, UnframedBytes
from app.sources.links.monitor import DELIMITERS
from app.sources.links.serial_url import check_url, open_port
from app.words import Message, Text
from firmware_protocol.framing import START_STREAM, STOP_STREAM, BadFrame, Frame, FrameDecoder

SILENCE_S = 1.0
UNFRAMED_S = 1.0  # with bytes and without a frame: these are no frames of the master
LAST_BYTES = 64  # last bytes, shown for diagnosis
POLL_S = 0.1
_BACKLOG_BYTES = 1024  # a longer piece has waited: a master that is read in time leaves less at once


@dataclass
class Backoff:
    """Exponential with jitter and a cap; `reset` after a success."""

    first_s: float = 0.2
    cap_s: float = 2.0
    rng: random.Random = field(default_factory=random.Random)
    _next_s: float = 0.0

    def reset(self) -> None:
        """The next failure waits shortly again."""
        self._next_s = 0.0

    def next_s(self) -> float:
        """Return the wait after one more failure: at most cap_s, at least half of the step."""
        self._next_s = min(self.cap_s, self._next_s * 2 or self.first_s)
        return self._next_s * (0.5 + self.rng.random() / 2)


class _UnframedWatch:
    """Bytes that arrive while no good frame does; one item every UNFRAMED_S."""

    def __init__(self, now_ns: int) -> None:
        self._since_ns = now_ns  # the last good frame, or the last item
        self._count = 0
        self._last = b""

    def add(self, now_ns: int, wall_ns: int, data: bytes, frames: list[Frame | BadFrame]) -> UnframedBytes | None:
        """Take what was read and the frames that it completed."""
        if any(isinstance(frame, Frame) for frame in frames):
            self._since_ns, self._count, self._last = now_ns, 0, b""
            return None
        self._count += len(data) - sum(len(frame.raw) + DELIMITERS for frame in frames)
        self._last = (self._last + data)[-LAST_BYTES:]
        if now_ns - self._since_ns < UNFRAMED_S * 1e9:
            return None
        unframed_bytes = UnframedBytes(now_ns, wall_ns, max(0, self._count), self._last)
        self._since_ns, self._count = now_ns, 0
        return unframed_bytes


class SerialLink:
    """Gives each frame to `on_frame` and then to `sink`, from its own thread."""

    def __init__(self, url: str, sink: Callable[[Item], None], clock: Clock, backoff: Backoff | None = None) -> None:
        check_url(url, by_operator=True)  # a request's was checked before
        self.url = url
        self.streams = True  # false: the crew asked for silence, `x` is not repeated
        self.on_frame: Callable[[Frame | BadFrame], bool] = lambda frame: True  # False: a reply nobody asked for
        self.on_lost: Callable[[], None] = lambda: None  # nothing is sent over the connection any more
        self._sink = sink
        self._clock = clock
        self._backoff = backoff or Backoff()
        self._port: serial.Serial | None = None
        self._write_lock = threading.Lock()
        self._stopping = threading.Event()
        self.beat_ns: int | None = None  # when the thread was last seen at work; None before it starts
        self._thread = threading.Thread(target=self._run, name="rs232", daemon=True)

    def start(self) -> None:
        """Begin to open the port."""
        self._thread.start()

    def stop(self) -> None:
        """Stop the stream, close the port, end the thread."""
        with contextlib.suppress(LinkLost):
            self.stream(on=False)
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join(timeout=3.0)

    def write(self, data: bytes) -> None:
        """Send bytes.

        Raises:
            LinkLost: the port is not open, or closed while writing.
        """
        with self._write_lock:
            port = self._port
            if port is None:
                raise LinkLost(Message("port-not-open", url=self.url))
            try:
                port.write(data)
            except (serial.SerialException, OSError) as error:
                raise LinkLost(Message("of-source", source=self.url, reason=str(error))) from error

    def stream(self, *, on: bool) -> None:
        """Ask the master to start or stop its stream."""
        self.streams = on
        self.write(bytes([START_STREAM if on else STOP_STREAM]))

    def _run(self) -> None:
        self._report("connecting")
        while not self._stopping.is_set():
            self.beat_ns = self._clock.monotonic_ns()
            try:
                port = self._open()
            except Exception as error:  # noqa: BLE001  drivers raise their own: termios.error is no OSError
                self._report("lost", reason_of(error, self.url))
                self._stopping.wait(self._backoff.next_s())
                continue
            self._report("open")
            self._port = port
            try:
                self._read_until_lost(port, self._backoff.reset)
            except Exception as error:  # noqa: BLE001  as above
                if not self._stopping.is_set():
                    self._report("lost", reason_of(error, self.url))
            finally:
                with self._write_lock:
                    self._port = None
                with contextlib.suppress(Exception):
                    port.close()
                self.on_lost()
            self._stopping.wait(self._backoff.next_s())

    def _open(self) -> serial.Serial:
        return open_port(self.url, POLL_S)

    def _read_until_lost(self, port: serial.Serial, on_data: Callable[[], None]) -> None:
        """Read for ever; `on_data` is called for what arrives: a port that opens and says nothing proves little."""
        read = port_reader(port, self._clock)
        decoder = FrameDecoder()
        empty_ns: int | None = None  # all that had arrived before this time has been read
        silent_since = self._clock.monotonic_s()
        unframed = _UnframedWatch(self._clock.monotonic_ns())
        self.stream(on=self.streams)
        while not self._stopping.is_set():
            data, looked_ns = read()
            now_ns = self.beat_ns = self._clock.monotonic_ns()
            if data:
                on_data()
                wall_ns = self._clock.wall_ns()
                in_time = len(data) < _BACKLOG_BYTES
                waited_max_ns = now_ns - empty_ns if in_time and empty_ns is not None else None
                frames = [(frame, self.on_frame(frame)) for frame in decoder.feed(data)]
                for frame, is_asked in frames:  # replies have left already: the sink may wait
                    self._sink(SerialItem(now_ns, wall_ns, frame, waited_max_ns, is_asked))
                unframed_bytes = unframed.add(now_ns, wall_ns, data, [frame for frame, _ in frames])
                if unframed_bytes is not None:
                    self._sink(unframed_bytes)
                empty_ns = looked_ns if in_time else None
                silent_since = now_ns / 1e9
                continue
            empty_ns = looked_ns
            if self.streams and now_ns / 1e9 - silent_since > SILENCE_S:
                silent_since = now_ns / 1e9
                self.stream(on=True)

    def _report(self, state: str, error: Text | None = None) -> None:
        self._sink(LinkChange(self._clock.monotonic_ns(), self._clock.wall_ns(), "rs232", state, error))  # type: ignore[arg-type]


def port_reader(port: serial.Serial, clock: Clock) -> Callable[[], tuple[bytes, int]]:
    """Return a function that waits at most POLL_S and returns all that has arrived, and the time before it looked.

    The time is read before the bytes: the process may stand still between the two, and what arrives then is not among
    them. Where the port has a file descriptor it is read directly: pySerial's socket:// hands over one byte a call.
    """
    try:
        descriptor = port.fileno() if os.name == "posix" else None
    except (AttributeError, OSError, ValueError):
        descriptor = None

    if descriptor is None:

        def read_port() -> tuple[bytes, int]:
            looked_ns = clock.monotonic_ns()
            return bytes(port.read(max(1, port.in_waiting))), looked_ns

        return read_port

    def read_descriptor() -> tuple[bytes, int]:
        looked_ns = clock.monotonic_ns()
        ready, _, _ = select.select([descriptor], [], [], POLL_S)
        if not ready:
            return b"", looked_ns
        looked_ns = clock.monotonic_ns()
        data = os.read(descriptor, 4096)
        if not data:
            raise LinkLost(Message("closed-by-other-end"))
        return data, looked_ns

    return read_descriptor


def reason_of(error: Exception, url: str) -> Text:
    """One line about a port that a pit crew understands."""
    text = str(error)
    if "No such file" in text or "FileNotFoundError" in text:
        return Message("port-missing", port=url)
    if "Permission denied" in text:
        return Message("port-denied")
    if "exclusively lock" in text or "resource busy" in text:
        return Message("port-in-use")
    if "refused" in text:
        return Message("connection-refused")
    if "Input/output error" in text or "[Errno 5]" in text:
        return Message("unplugged")
    return message_of(error)
