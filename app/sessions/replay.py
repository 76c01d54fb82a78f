"""A recorded session through a pipeline of its own, shown instead of the live one, which goes on recording."""

import logging
import queue
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Literal

import numpy as np

from app.clock import Clock
from app.errors import AppError, ConfigError, NotNow, message_of
from app.live.accumulator import charge_of
from app.live.cells import extreme, mean
from app.live.pipeline import Pipeline
from app.sessions.info import RecordedCanFrame
from app.sessions.reading.reader import SessionFile
from app.sessions.reading.recorded_estimates import RecordedEstimates
from app.sessions.replay_schedule import LEAD_S, MIN_LOOP_S, Pacer, Received
from app.sources.items import CanItem, Item, LinkChange, SerialBytes, SerialItem, TableItem
from app.sources.loaded_battery import LoadedBattery
from app.telemetry import FloatArray, Snapshot, TripCause
from app.telemetry.service_state import Replay, ReplayCompared
from app.words import Message
from firmware_protocol.framing import decode_chunk

log = logging.getLogger(__name__)
IDLE_S = 0.05
JUMP_S = 0.01
START_S = 10.0
END_S = 1.0
REPEAT_S = 0.5  # a replay that stands still says so this often
SESSION_CELL: Final = "session"  # name of the cell file that the session keeps
Estimates = Literal["recomputed", "recorded"]


@dataclass(frozen=True)
class ReplayOptions:
    """Options of a replay: the filter and cell that recompute the estimates, and which are shown.

    None = the service's filter; the session's own cell file, the service's where it keeps none.
    """

    speed: float = 1.0
    filter_name: str | None = None
    cell_name: str | None = None
    estimates: Estimates = "recomputed"


NewPipeline = Callable[[float | None], Pipeline]
"""Makes a fresh pipeline; from a unix time on it knows what the cells had shown until then."""


@dataclass
class _Replay:
    """What the replay's thread works on."""

    file: SessionFile
    pacer: Pacer
    recorded: RecordedEstimates
    new_pipeline: NewPipeline
    pipeline: Pipeline
    options: ReplayOptions
    jumped_to_s: float | None = None  # a position from which on a fresh pipeline is needed
    cause: "Future[TripCause | None] | None" = None  # cause of the active trip
    compared: ReplayCompared | None = None


Orders = queue.SimpleQueue[Callable[[_Replay, float], None] | None]


def item_of(received: Received, battery: LoadedBattery | None = None) -> Item:
    """Return the item that the link delivered when this was recorded; None: of the team's battery."""
    if isinstance(received, TableItem):
        return received
    if isinstance(received, RecordedCanFrame):
        return CanItem(received.t_mono_ns, received.t_wall_ns, received.can_id, received.data)
    if battery is not None and battery.serial is not None:
        return SerialBytes(received.t_mono_ns, received.t_wall_ns, received.raw)
    return SerialItem(received.t_mono_ns, received.t_wall_ns, decode_chunk(received.raw))


def prepare(pipeline: Pipeline, file: SessionFile) -> None:
    """Put a fresh pipeline into the state in which the links had just opened."""
    info = file.info
    started_ns, wall_ns = info.started_mono_ns, info.started_wall_ns
    for link in ("rs232", "can"):
        pipeline.feed(LinkChange(started_ns, wall_ns, link, "open", map_hash=info.map_hash))


class ReplayPlayer:
    """Plays at most one replay at a time, in a thread of its own, which alone touches the opened file."""

    def __init__(
        self,
        pipelines_of: Callable[[SessionFile, ReplayOptions], NewPipeline],
        find_cause: Callable[[SessionFile, float], TripCause | None],
        show: Callable[[Snapshot], None],
        on_failure: Callable[[Message], None],
        clock: Clock,
        *,
        end_s: float = END_S,
        open_file: Callable[[Path], SessionFile] = SessionFile,
    ) -> None:
        """Prepare; nothing is opened.

        Args:
            pipelines_of: returns what makes the pipelines of a session.
            find_cause: returns what caused the trip that holds at a unix time; it takes seconds, in another thread.
            show: is given each snapshot.
            on_failure: is given why a replay ended.
            clock: of the service.
            end_s: how long to wait for a replay that has to end.
            open_file: opens its session.
        """
        self._clock = clock
        self._end_s = end_s
        self._open_file = open_file
        self._pipelines_of = pipelines_of
        self._find_cause = find_cause
        self._show = show
        self._on_failure = on_failure
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None
        self._orders: Orders = queue.SimpleQueue()
        self._state: Replay | None = None
        self._latest: Snapshot | None = None
        self._state_lock = threading.Lock()  # held from asking whether a thread is the current one to setting its state

    @property
    def is_active(self) -> bool:
        """A replay is shown."""
        return self._thread is not None

    def start(self, path: Path, options: ReplayOptions) -> None:
        """Begin at the start of a session; another replay ends.

        Raises:
            AppError: the file cannot be played, or not with this filter or cell; nothing is shown of it.
        """
        with self._lock:
            replay = self._opened(path, options)
            self._end()
            self._latest = None
            self._orders = queue.SimpleQueue()
            started: Future[None] = Future()
            arguments = (replay, self._orders, started)
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
        with self._state_lock:
            thread, self._thread, self._state = self._thread, None, None
        if thread is not None:
            self._orders.put(None)
            thread.join(timeout=self._end_s)  # one that compiles a filter ends later, and says nothing more

    def _is_current(self) -> bool:
        """Whether the calling thread is that of the current replay, not of one that was stopped."""
        return threading.current_thread() is self._thread

    def _publish_state(self, replay: _Replay, now_s: float) -> None:
        state = _state(replay, now_s)
        with self._state_lock:
            if self._is_current():
                self._state = state

    def control(
        self,
        *,
        paused: bool | None = None,
        speed: float | None = None,
        seek_s: float | None = None,
        step: bool = False,
        loop: tuple[float, float] | Literal["off"] | None = None,
        estimates: Estimates | None = None,
    ) -> None:
        """Change how it plays; only what is given changes.

        Raises:
            NotNow: nothing is replayed.
            ConfigError: the loop does not fit the session.
        """
        state = self._state
        if not self.is_active or state is None:
            raise NotNow(Message("nothing-replayed"))
        if isinstance(loop, tuple) and not 0.0 <= loop[0] < loop[1] <= state.duration_s + MIN_LOOP_S:
            raise ConfigError("loop", list(loop), Message("loop-in-session", duration=f"{state.duration_s:.1f} s"))

        def order(replay: _Replay, now_s: float) -> None:
            pacer = replay.pacer
            if speed is not None:
                pacer.set_speed(speed, now_s)
            if paused is not None:
                (pacer.pause if paused else pacer.resume)(now_s)
            if loop == "off":
                pacer.loop = None
            elif loop is not None:
                pacer.set_loop(*loop)
            if estimates is not None:
                replay.options = replace(replay.options, estimates=estimates)
            if seek_s is not None:
                _jump(replay, seek_s, now_s)
            if step:
                self._take(replay, pacer.step())

        self._orders.put(order)

    def state(self) -> Replay | None:
        """Return its position; None without a replay."""
        return self._state

    def _opened(self, path: Path, options: ReplayOptions) -> _Replay:
        """Open a session at its start; what cannot be played is refused before the replay that is shown ends."""
        file = self._open_file(path)
        try:
            new_pipeline = self._pipelines_of(file, options)
            pacer = Pacer(file, now_s=self._clock.monotonic_s(), speed=options.speed)
            return _Replay(file, pacer, RecordedEstimates(file), new_pipeline, new_pipeline(None), options)
        except BaseException:
            file.close()
            raise

    def _run(self, replay: _Replay, orders: Orders, started: "Future[None]") -> None:
        try:
            with replay.file:
                prepare(replay.pipeline, replay.file)
                self._publish_state(replay, self._clock.monotonic_s())
                started.set_result(None)
                replay.pipeline.warm_up()  # compiling a filter takes seconds, which are not the session's
                replay.pacer.seek(0.0, self._clock.monotonic_s())
                self._play(replay, orders)
        except Exception as error:
            if not started.done():
                started.set_exception(error)
                return
            log.exception("the replay failed")
            self._on_failure(Message("replay-failed", session=replay.file.path.stem, error=message_of(error)))
        finally:
            with self._state_lock:
                if self._is_current():  # nobody waits for this end: the live source is shown again
                    self._thread = self._state = None

    def _play(self, replay: _Replay, orders: Orders) -> None:
        pacer, shown_s = replay.pacer, 0.0
        while self._is_current():
            now_s = self._clock.monotonic_s()
            if pacer.loop is not None and pacer.is_loop_over(now_s):
                _jump(replay, pacer.loop[0], now_s)
            if replay.jumped_to_s is not None:
                self._publish_state(replay, now_s)
                position_s, replay.jumped_to_s = replay.jumped_to_s, None
                _renew(replay, position_s)
                now_s = self._clock.monotonic_s()
                if not pacer.is_paused:
                    pacer.seek(position_s, now_s)  # what the new pipeline took to learn is not the session's time
            self._publish_state(replay, now_s)
            if self._take(replay, pacer.due(now_s)):
                shown_s = now_s
            if self._latest is not None and now_s - shown_s > REPEAT_S:
                shown_s = now_s
                self._show(replace(self._latest, is_fresh=False))
            wait_s = pacer.wait_s(now_s)
            try:
                order = orders.get(timeout=IDLE_S if wait_s is None else min(wait_s, IDLE_S))
            except queue.Empty:
                continue
            if order is None:
                return
            order(replay, self._clock.monotonic_s())

    def _take(self, replay: _Replay, due: Sequence[Received]) -> bool:
        """Put what is due through the pipeline; True where something was shown."""
        shown = False
        for received in due:
            if not self._is_current():
                break
            snapshot = replay.pipeline.feed(item_of(received, replay.file.loaded_battery)).snapshot
            replay.pipeline.predict()
            if snapshot is None or not self._is_current():
                continue
            self._explain(replay, snapshot)
            recorded = replay.recorded.at(snapshot.t_mono_ns)
            replay.compared = _compared(snapshot, recorded)
            if replay.options.estimates == "recorded":
                snapshot = as_recorded(snapshot, recorded)
            self._latest, shown = snapshot, True
            self._show(snapshot)
        return shown

    def _explain(self, replay: _Replay, snapshot: Snapshot) -> None:
        """Look for the cause of a trip while it plays on, and tell it to the alarms that hold."""
        trips = [alarm for alarm in snapshot.alarms if alarm.severity == "trip" and alarm.active]
        if not trips:
            replay.cause = None
        elif replay.cause is None:
            replay.cause = Future()
            arguments = (replay.file, replay.file.unix_s(snapshot.t_mono_ns), replay.cause)
            threading.Thread(target=self._set_cause, args=arguments, name="replay cause", daemon=True).start()
        elif replay.cause.done() and any(alarm.cause is None for alarm in trips):
            cause = replay.cause.result()
            if cause is not None:
                replay.pipeline.explain(cause)

    def _set_cause(self, file: SessionFile, at_s: float, future: "Future[TripCause | None]") -> None:
        try:
            with SessionFile(file.path, parse=file.parse) as session:
                future.set_result(self._find_cause(session, at_s))
        except AppError as error:
            log.warning("the cause of a trip was not evaluated: %s", error)
            future.set_result(None)


def as_recorded(snapshot: Snapshot, recorded: tuple[FloatArray, FloatArray] | None) -> Snapshot:
    """Return a snapshot with the charge that was estimated when it was recorded; missing where nothing was."""
    nothing = np.full(len(snapshot.cells.soc), np.nan)
    soc, sigma = recorded if recorded is not None else (nothing, nothing)
    charge = charge_of(soc, sigma, None, None)  # the driver's is smoothed over samples that a replay may jump over
    cells = replace(snapshot.cells, soc=soc, soc_sigma=sigma)
    return replace(snapshot, cells=cells, accumulator=replace(snapshot.accumulator, **charge))


def _compared(snapshot: Snapshot, recorded: tuple[FloatArray, FloatArray] | None) -> ReplayCompared:
    """Both estimates at one instant, and where they differ the most."""
    recomputed = snapshot.cells.soc
    was = np.full(len(recomputed), np.nan) if recorded is None else recorded[0]
    difference, cell = extreme(np.abs(recomputed - was), highest=True)
    return ReplayCompared(
        recorded_soc=mean(was),
        recorded_soc_min=extreme(was, highest=False)[0],
        recomputed_soc=mean(recomputed),
        recomputed_soc_min=extreme(recomputed, highest=False)[0],
        largest_difference=difference,
        largest_difference_cell=cell,
    )


def _jump(replay: _Replay, position_s: float, now_s: float) -> None:
    """Go to a position; from there on a fresh pipeline is needed."""
    before_s = replay.pacer.position_s(now_s)
    replay.pacer.seek(position_s, now_s)
    if abs(replay.pacer.position_s(now_s) - before_s) > JUMP_S or replay.pacer.position_s(now_s) == 0.0:
        replay.jumped_to_s = replay.pacer.position_s(now_s)


def _renew(replay: _Replay, position_s: float) -> None:
    """Put a fresh pipeline in the place of the one that played another part; it knows what cells had shown before."""
    file = replay.file
    since_s = position_s - LEAD_S
    from_s = None if since_s <= 0.0 else file.unix_s(file.info.started_mono_ns + round(since_s * 1e9))
    replay.pipeline, replay.cause = replay.new_pipeline(from_s), None
    prepare(replay.pipeline, file)


def _state(replay: _Replay, now_s: float) -> Replay:
    pacer, options = replay.pacer, replay.options
    return Replay(
        session_id=replay.file.info.id,
        position_s=round(pacer.position_s(now_s), 3),
        duration_s=pacer.duration_s,
        speed=pacer.speed,
        paused=pacer.is_paused,
        finished=pacer.is_finished,
        loop=pacer.loop,
        filter=replay.pipeline.filter_name,
        cell=replay.pipeline.cell_name,
        estimates=options.estimates,
        compared=replay.compared,
    )
