"""The measuring station: one serial link to the master, everything that comes recorded, requests answered."""

import threading
from collections.abc import Callable
from pathlib import Path

from app.analysis.evidence.looks import Look, Values, looks
from app.analysis.evidence.timing import TRIPS
from app.clock import Clock
from app.errors import LinkLost
from app.sessions.info import SessionInfo
from app.sessions.recording.recorder import Recorder
from app.sources.items import Item, LinkChange, SerialItem
from app.sources.links.serial import SerialLink
from app.sources.master.client import MasterClient
from app.telemetry.link_messages import link_lost
from firmware_protocol.framing import BAUD_RATE, Frame
from firmware_protocol.memory_map import CONFIG_SIZE
from firmware_protocol.messages import EventMessage


class Station:
    """Reads and records from `start` to `stop`. Waits look at the newest fast frame and at every event."""

    def __init__(self, url: str, folder: Path, version: str, clock: Clock) -> None:
        self._clock = clock
        self.recorder = Recorder(folder, clock, version=version, keeps_empty=False)
        self._link = SerialLink(url, self._take, clock)
        self.client = MasterClient(self._link.write, clock)
        self._link.on_frame = self.client.on_frame
        self._news = threading.Condition()
        self._newest: Look | None = None
        self._lost: LinkChange | None = None
        self._trips: list[EventMessage] = []

    def start(self, name: str, metadata: dict[str, object]) -> SessionInfo:
        """Open the link and begin the session."""
        info = self.recorder.start(name, metadata)
        self._link.start()
        return info

    def stop(self) -> None:
        """End the stream and the session; everything is on the disk on return."""
        self.client.close()
        self._link.stop()
        self.recorder.close(30.0)

    def read_config(self) -> bytes:
        """Return the configuration in force, and record it."""
        image = self.client.read(0, CONFIG_SIZE)
        self.recorder.config(self._clock.monotonic_ns(), self._clock.wall_ns(), image, "in force at the start")
        return image

    def mark(self, kind: str, text: str) -> None:
        """Set a marker now."""
        self.recorder.marker(self._clock.monotonic_ns(), self._clock.wall_ns(), text, kind=kind)

    def forget_trips(self) -> None:
        """Trips that were told so far count no more."""
        with self._news:
            self._trips.clear()

    def wait(self, condition: Callable[[Values, list[EventMessage]], bool], seconds: float) -> bool:
        """Wait until the newest values and the trips since `forget_trips` fulfil a condition; False after the time."""
        with self._news:
            return self._news.wait_for(lambda: self._holds(condition), seconds)

    def wait_for_telemetry(self, seconds: float) -> bool:
        """Wait until the master speaks; False after the time.

        Raises:
            LinkLost: the port cannot be opened.
        """
        with self._news:
            self._news.wait_for(lambda: self._newest is not None or self._lost is not None, seconds)
            if self._newest is None and self._lost is not None:
                raise LinkLost(link_lost("rs232", self._lost.error))
            return self._newest is not None

    def rest(self, seconds: float) -> None:
        """Let so much be recorded."""
        self.wait(lambda *_: False, seconds)

    def _holds(self, condition: Callable[[Values, list[EventMessage]], bool]) -> bool:
        values = None if self._newest is None else self._newest.values
        return values is not None and condition(values, self._trips)

    def _take(self, item: Item) -> None:
        if isinstance(item, LinkChange) and item.state == "lost":
            with self._news:
                self._lost = item
                self._news.notify_all()
        if not isinstance(item, SerialItem):
            return
        frame = item.frame
        self.recorder.frame(item.t_mono_ns, item.t_wall_ns, 0, frame.raw, isinstance(frame, Frame))
        if not isinstance(frame, Frame):
            return
        for look in looks([(item.t_mono_ns, frame.raw)], BAUD_RATE):
            with self._news:
                if look.values is not None:
                    self._newest = look
                if look.event is not None and look.event.code in TRIPS:
                    self._trips.append(look.event)
                self._news.notify_all()
