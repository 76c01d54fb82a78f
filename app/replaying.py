"""A recorded session through a pipeline of its own, shown instead of the live one, which goes on recording."""

import logging
import queue
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path
from typing import Any

from app.errors import NotNow
from app.pipeline import Pipeline
from app.sessions.info import RecordedCanFrame, RecordedFrame
from app.sessions.reader import SessionFile
from app.sessions.replay import Pacer
from app.telemetry import CanItem, Item, LinkChange, SerialItem, Snapshot
from firmware_protocol.framing import decode_chunk

log = logging.getLogger(__name__)
IDLE_S = 0.05
JUMP_S = 0.01
START_S = 10.0
REPEAT_S = 0.5  # a replay that stands still says so this often
Orders = queue.SimpleQueue[Callable[[Pacer, float], None] | None]


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
    """At most one replay at a time, in a thread of its own, which alone touches the file."""

    def __init__(
        self,
        new_pipeline: Callable[..., Pipeline],
        show: Callable[[Snapshot], None],
        on_failure: Callable[[str], None],
    ) -> None:
        self._new_pipeline = new_pipeline
        self._show = show
        self._on_failure = on_failure
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None
        self._orders: Orders = queue.SimpleQueue()
        self._state: dict[str, Any] | None = None

    @property
    def is_active(self) -> bool:
        """A replay is shown."""
        return self._thread is not None

    def start(self, path: Path, speed: float) -> None:
        """Begin at the start of a session; another replay ends.

        Raises:
            AppError: the file cannot be played; nothing is shown of it.
        """
        with self._lock:
            self._end()
            self._orders = queue.SimpleQueue()
            started: Future[None] = Future()
            arguments = (path, speed, self._orders, started)
            self._thread = threading.Thread(target=self._run, args=arguments, name="replay", daemon=True)
            self._thread.start()
            try:
                started.result(timeout=START_S)
            except BaseException:
                self._end()
                raise

    def stop(self) -> None:
        """End the replay."""
        with self._lock:
            self._end()

    def _end(self) -> None:
        if self._thread is not None:
            self._orders.put(None)
            self._thread.join(timeout=5.0)
        self._thread = self._state = None

    def control(self, *, paused: bool | None, speed: float | None, seek_s: float | None) -> None:
        """Change how it plays.

        Raises:
            NotNow: nothing is replayed.
        """
        if not self.is_active:
            raise NotNow("nothing is replayed")

        def order(pacer: Pacer, now_s: float) -> None:
            if speed is not None:
                pacer.set_speed(speed, now_s)
            if paused is not None:
                (pacer.pause if paused else pacer.resume)(now_s)
            if seek_s is not None:
                pacer.seek(seek_s, now_s)

        self._orders.put(order)

    def state(self) -> dict[str, Any] | None:
        """Where it stands; None without one."""
        return self._state

    def _run(self, path: Path, speed: float, orders: Orders, started: "Future[None]") -> None:
        try:
            with SessionFile(path) as file:
                pacer = Pacer(file, now_s=time.monotonic(), speed=speed)
                self._state = _state(pacer, file, time.monotonic())
                started.set_result(None)
                self._play(file, pacer, orders)
        except Exception as error:
            if not started.done():
                started.set_exception(error)
                return
            log.exception("the replay failed")
            self._on_failure(f"the replay of {path.stem} failed: {error}")
        finally:
            if threading.current_thread() is self._thread:  # nobody waits for this end: the live source is shown again
                self._thread = self._state = None

    def _play(self, file: SessionFile, pacer: Pacer, orders: Orders) -> None:
        pipeline = self._new_pipeline("replay", "recorded", "recorded")
        prepare(pipeline, file)
        latest: Snapshot | None = None
        shown_s = 0.0
        while True:
            now_s = time.monotonic()
            self._state = _state(pacer, file, now_s)
            for received in pacer.due(now_s):
                snapshot = pipeline.feed(item_of(received)).snapshot
                pipeline.look_ahead()
                if snapshot is not None:
                    latest, shown_s = snapshot, now_s
                    self._show(snapshot)
            if latest is not None and now_s - shown_s > REPEAT_S:
                shown_s = now_s
                self._show(replace(latest, is_fresh=False))
            wait_s = pacer.wait_s(now_s)
            try:
                order = orders.get(timeout=IDLE_S if wait_s is None else min(wait_s, IDLE_S))
            except queue.Empty:
                continue
            if order is None:
                return
            if _jumps(pacer, order):
                pipeline = self._new_pipeline("replay", "recorded", "recorded")
                prepare(pipeline, file)


def _jumps(pacer: Pacer, order: Callable[[Pacer, float], None]) -> bool:
    """Carry out an order; True where the position jumped, so that a fresh chain is needed."""
    now_s = time.monotonic()
    before_s = pacer.position_s(now_s)
    order(pacer, now_s)
    return abs(pacer.position_s(now_s) - before_s) > JUMP_S


def _state(pacer: Pacer, file: SessionFile, now_s: float) -> dict[str, Any]:
    return {
        "session_id": file.info.id,
        "position_s": round(pacer.position_s(now_s), 3),
        "duration_s": pacer.duration_s,
        "speed": pacer.speed,
        "paused": pacer.is_paused,
        "finished": pacer.is_finished,
    }
