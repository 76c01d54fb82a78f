"""A recorded session through a pipeline of its own, shown instead of the live one, which goes on recording."""

import threading
import time
from collections.abc import Callable
from typing import Any

from app.pipeline import Pipeline
from app.sessions.info import RecordedCanFrame, RecordedFrame
from app.sessions.reader import SessionFile
from app.sessions.replay import Pacer
from app.telemetry import CanItem, Item, LinkChange, SerialItem, Snapshot
from firmware_protocol.framing import decode_chunk

IDLE_S = 0.05


def item_of(received: RecordedFrame | RecordedCanFrame) -> Item:
    """The item that the link delivered when this was recorded."""
    if isinstance(received, RecordedCanFrame):
        return CanItem(received.t_mono_ns, received.t_wall_ns, received.can_id, received.data)
    return SerialItem(received.t_mono_ns, received.t_wall_ns, decode_chunk(received.raw))


def prepare(pipeline: Pipeline, file: SessionFile) -> None:
    """Put a fresh pipeline into the state in which the links had just opened."""
    started_ns, wall_ns = file.info.started_mono_ns, file.info.started_wall_ns
    for link in ("rs232", "can"):
        pipeline.feed(LinkChange(started_ns, wall_ns, link, "open"))


class Replaying:
    """At most one replay at a time."""

    def __init__(self, new_pipeline: Callable[..., Pipeline], show: Callable[[Snapshot], None]) -> None:
        self._new_pipeline = new_pipeline
        self._show = show
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None
        self._pacer: Pacer | None = None
        self._file: SessionFile | None = None
        self._stopping = threading.Event()

    @property
    def is_active(self) -> bool:
        """A replay is shown."""
        return self._pacer is not None

    def start(self, file: SessionFile, speed: float) -> None:
        """Begin at the start of a session; another replay ends."""
        self.stop()
        with self._lock:
            self._stopping.clear()
            self._file = file
            self._pacer = Pacer(file, now_s=time.monotonic(), speed=speed)
            self._thread = threading.Thread(target=self._run, args=(file, self._pacer), name="replay", daemon=True)
            self._thread.start()

    def stop(self) -> None:
        """End the replay."""
        with self._lock:
            self._stopping.set()
            if self._thread is not None:
                self._thread.join(timeout=5.0)
            if self._file is not None:
                self._file.close()
            self._thread = self._pacer = self._file = None

    def control(self, *, paused: bool | None, speed: float | None, seek_s: float | None) -> None:
        """Change how it plays; nothing without a replay."""
        pacer = self._pacer
        if pacer is None:
            return
        now_s = time.monotonic()
        if speed is not None:
            pacer.set_speed(speed, now_s)
        if paused is not None:
            pacer.pause(now_s) if paused else pacer.resume(now_s)
        if seek_s is not None:
            pacer.seek(seek_s, now_s)

    def state(self) -> dict[str, Any] | None:
        """Where it stands; None without one."""
        pacer, file = self._pacer, self._file
        if pacer is None or file is None:
            return None
        return {
            "session_id": file.info.id,
            "position_s": round(pacer.position_s(time.monotonic()), 3),
            "duration_s": file.info.duration_s,
            "speed": pacer.speed,
            "paused": pacer.is_paused,
        }
