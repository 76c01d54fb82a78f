"""Frames that are received on a bus for some time, for learning and checking."""

import threading
import time
from collections import deque

from app.errors import LinkLost, message_of
from app.sources.dbc.frames import Frames, TimedFrame, frames_of
from app.sources.links.can_bus import open_bus, parse_bus
from app.words import Message, Text
from firmware_protocol.memory_map import CAN_ID_EXTENDED

_POLL_S = 0.2
_MOST_FRAMES = 300_000  # two minutes of a full bus


class BusListener:
    """Receives frames of a bus in a thread and keeps the newest; ends automatically when nobody reads them."""

    def __init__(self, url: str, idle_s: float = 30.0, *, by_operator: bool = False) -> None:
        """Open the bus.

        Args:
            url: a python-can interface and channel, INTERFACE:CHANNEL.
            by_operator: the command line names it, see `parse_bus`.
            idle_s: how long after the last question it ends.

        Raises:
            ConfigError: the bus is not INTERFACE:CHANNEL.
            LinkLost: the bus cannot be opened.
        """
        arguments = parse_bus(url, by_operator=by_operator)
        try:
            self._bus = open_bus(arguments)
        except Exception as error:  # every driver raises its own
            raise LinkLost(Message("of-source", source=url, reason=message_of(error))) from error
        self._frames: deque[TimedFrame] = deque(maxlen=_MOST_FRAMES)
        self._idle_s = idle_s
        self._asked_s = time.monotonic()
        self.lost: Text | None = None  # why the bus is received no more
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="learn", daemon=True)
        self._thread.start()

    @property
    def is_open(self) -> bool:
        """True while more frames may come."""
        return not self._ended.is_set()

    def frames(self) -> Frames:
        """Return the frames received so far; it stays open."""
        self._asked_s = time.monotonic()
        return frames_of(list(self._frames))

    def wait(self, duration_s: float) -> Frames:
        """Return what is kept after some time; at once where the bus is lost meanwhile."""
        self._asked_s = time.monotonic() + duration_s
        self._ended.wait(duration_s)
        return self.frames()

    def close(self) -> None:
        """End it and give the bus free."""
        self._ended.set()
        self._thread.join()

    def _run(self) -> None:
        try:
            while not self._ended.is_set() and time.monotonic() < self._asked_s + self._idle_s:
                message = self._bus.recv(_POLL_S)
                if message is not None and not (message.is_error_frame or message.is_remote_frame):
                    can_id = message.arbitration_id | (CAN_ID_EXTENDED if message.is_extended_id else 0)
                    self._frames.append((time.monotonic_ns(), can_id, bytes(message.data)))
        except Exception as error:  # noqa: BLE001  # every driver raises its own: the adapter is gone, what was received stays
            self.lost = message_of(error)
        finally:
            self._ended.set()
            self._bus.shutdown()


def bus_frames(url: str, duration_s: float) -> Frames:
    """Listen to a bus and return what was received; what was received until then where Ctrl+C ends it.

    Raises:
        ConfigError: the bus is not INTERFACE:CHANNEL.
        LinkLost: the bus cannot be opened.
    """
    listener = BusListener(url, by_operator=True)
    try:
        return listener.wait(duration_s)
    except KeyboardInterrupt:
        return listener.frames()
    finally:
        listener.close()
