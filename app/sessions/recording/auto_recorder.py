"""The automatic start and end of recordings, and their contents."""

import threading
from collections.abc import Callable
from pathlib import Path

from app import __version__
from app.clock import Clock
from app.errors import AppError, NotNow
from app.live.pipeline import Output
from app.sessions.errors import RecordingFailed
from app.sessions.info import RecorderStatus, SessionInfo
from app.sessions.recording.disk import DiskLimits
from app.sessions.recording.recorder import Recorder
from app.sessions.recording.session_names import RecordingPlan, load_plan, next_part, save_plan
from app.sources.items import CanItem, Item, SerialBytes, SerialItem
from app.sources.loaded_battery import LoadedBattery
from app.telemetry import Event, Severity, Source
from app.telemetry.service_state import Stall
from app.words import Message
from firmware_protocol.framing import Frame

GONE_S = 60.0  # the master has been silent this long: the session is over
CLOCK_S = 10.0
STATUS_S = 0.5
RETRY_S = 5.0  # where a recording could not be started
LATEST_NS = 30_000_000_000  # an event is no later: the wall clock was set
SERIAL_LINK = 0


class AutoRecorder:
    """Starts with the master's first good frame, stops when it has been gone for a while.

    A session stopped by hand stays stopped until the master was gone once, or somebody starts one.
    """

    def __init__(
        self,
        folder: Path,
        *,
        automatic: bool,
        on_event: Callable[[Event], None],
        clock: Clock,
        event: str | None = None,
        limits: DiskLimits | None = None,
        source: Source | None = None,
        cell_file: str | None = None,
        battery: LoadedBattery | None = None,
        car: str | None = None,
    ) -> None:
        """Open the folder; the plan of the next sessions lies next to it.

        `source` is kept in every session, so that a simulated car is never taken for a real one; the text of the cell
        file, so that the session is judged with it later, too; and the battery, whose profile explains the frames.
        `car`, where there are several, too: a season keeps them apart.

        Raises:
            ConfigError: the event's name is too long.
        """
        folder.mkdir(parents=True, exist_ok=True)
        self._plan_path = folder.parent / "recording.json"
        self._plan = load_plan(self._plan_path, event)
        about = {"source": source, "car": car}
        self._about: dict[str, object] = {name: value for name, value in about.items() if value is not None}
        self._clock = clock
        self._recorder = Recorder(
            folder,
            clock,
            version=__version__,
            limits=limits,
            next_name=next_part,
            cell_file=cell_file,
            battery=battery,
            keeps_empty=False,
        )
        self._automatic = automatic
        self._on_event = on_event
        self._lock = threading.Lock()
        self._starting = threading.Lock()
        self._held_back = not automatic
        self._last_good_ns: int | None = None
        self._last_clock_ns = 0
        self._retry_ns = 0
        self._config: bytes | None = None
        self._map_hash: str | None = None  # the master's memory map, by its IDENT
        self._status: tuple[float, RecorderStatus] | None = None
        self._reported: Message | str | None = None
        self.start_failure: Message | None = None  # why nothing is recorded although the master sends
        self._failing_ns: int | None = None  # since when, wall clock
        self._session_id: str | None = None

    @property
    def status(self) -> RecorderStatus:
        """The recorder, at most STATUS_S old."""
        now, last = self._clock.monotonic_s(), self._status  # another thread may forget it meanwhile
        if last is None or now - last[0] > STATUS_S:
            self._status = last = now, self._recorder.status
        return last[1]

    @property
    def session(self) -> SessionInfo | None:
        """The session being recorded."""
        return self.status.session

    @property
    def session_id(self) -> str | None:
        """Return the id of the session that is recorded."""
        return None if (session := self.session) is None else session.id

    @property
    def stall(self) -> Stall | None:
        """Return why nothing reaches the disk although it should, and since when; None where all is well."""
        status = self.status
        if status.error is not None and status.stalled_ns is not None and status.session is not None:
            return Stall(status.stalled_ns, status.error)
        if self.start_failure is not None and self._failing_ns is not None and status.session is None:
            return Stall(self._failing_ns, self.start_failure)
        return None

    def stuck(self) -> list[Message]:
        """Return that the recorder's thread has ended; one that waits for the disk is not stuck."""
        error = self.status.error
        return [] if self._recorder.is_alive or error is None else [error]

    @property
    def commit_delay_s(self) -> float | None:
        """Return how long the newest frames took to the disk, or wait already; None while nothing is recorded."""
        return self._recorder.commit_delay_s

    def wait_for_commit(self, timeout_s: float) -> None:
        """Return when a commit that is due is done, or after so long: see `Recorder.wait_for_commit`."""
        self._recorder.wait_for_commit(timeout_s)

    def start(self, name: str | None = None) -> SessionInfo:
        """Begin a session now.

        Raises:
            NotNow: one is being recorded.
        """
        with self._lock:
            plan = self._plan
            info = self._recorder.start(name or plan.name(self._clock.wall_ns()), plan.metadata() | self._about)
            self._held_back = False
            self._config = None
            self._status = None
            self._session_id = info.id
            self.start_failure = self._failing_ns = None
        self._on_event(self._event("recording-started", Message("recording-started", session=info.id)))
        return info

    def stop(self) -> SessionInfo | None:
        """End the session and keep from starting another one by itself."""
        with self._lock:
            self._held_back = True
        return self._end(Message("ended-by-hand"))

    def file_loss(self, session_id: str) -> Message | None:
        """Return what to say of a session whose file was lost while it was recorded."""
        return self._recorder.file_loss(session_id)

    def split(self) -> SessionInfo:
        """End the session and go on in a new file without losing a frame.

        Raises:
            NotNow: nothing is being recorded.
            RecordingFailed: the new file cannot be created; the session goes on.
        """
        with self._lock:
            info = self._recorder.split(self._plan.metadata() | self._about)
            self._status = None
        self._report_split()
        return info

    @property
    def plan(self) -> RecordingPlan:
        """Return the name and facts of the next sessions."""
        return self._plan

    def set_plan(self, plan: RecordingPlan) -> None:
        """Use it from the next session on, also after a restart.

        Raises:
            OSError: the disk does not keep it.
        """
        save_plan(self._plan_path, plan)
        with self._lock:
            self._plan = plan

    def close(self) -> None:
        """Write what is left and end the thread."""
        self._recorder.close()

    def flush(self) -> None:
        """Return once all is on the disk."""
        self._recorder.flush()

    def marker(self, text: str, kind: str, who: str | None, ago_s: float = 0.0) -> None:
        """Mark this instant, or one so long ago: whoever writes a note first pressed a key."""
        ago_ns = round(ago_s * 1e9)
        self._recorder.marker(
            self._clock.monotonic_ns() - ago_ns, self._clock.wall_ns() - ago_ns, text, kind=kind, who=who
        )

    def on_item(self, item: Item) -> None:
        """Record what a link delivered, before anything else looks at it."""
        if isinstance(item, SerialItem):
            frame = item.frame
            good = isinstance(frame, Frame)
            if good:
                self._master_received(item.t_mono_ns)
            self._recorder.frame(item.t_mono_ns, item.t_wall_ns, SERIAL_LINK, frame.raw, good)
            if isinstance(frame, Frame) and item.t_mono_ns - self._last_clock_ns > CLOCK_S * 1e9:
                self._last_clock_ns = item.t_mono_ns
                self._recorder.clock(item.t_mono_ns, item.t_wall_ns, frame.uptime_ms)
        elif isinstance(item, SerialBytes):
            self._master_received(item.t_mono_ns)
            self._recorder.frame(item.t_mono_ns, item.t_wall_ns, SERIAL_LINK, item.data, True)
        elif isinstance(item, CanItem):
            if not item.sent:
                self._master_received(item.t_mono_ns)
            self._recorder.can_frame(item.t_mono_ns, item.t_wall_ns, item.can_id, item.data)

    def on_output(self, output: Output) -> None:
        """Record what the pipeline made of it; end the session when the master has been gone for long."""
        if output.estimates is not None:
            self._recorder.estimates(
                output.t_mono_ns, output.uptime_ms, output.estimates.soc, output.estimates.soc_sigma
            )
        snapshot = output.snapshot
        if snapshot is None:
            return
        self._note_map(snapshot.master.map_hash)
        with self._lock:  # a session that begins between the two would miss its configuration
            if snapshot.config is not None and self._config != snapshot.config:
                why = "in force at the start" if self._config is None else "changed"
                self._config = snapshot.config
                self._recorder.config(snapshot.t_mono_ns, snapshot.t_wall_ns, self._config, why)
        if self._last_good_ns is not None and snapshot.t_mono_ns - self._last_good_ns > GONE_S * 1e9:
            self._last_good_ns = None
            self._held_back = not self._automatic
            self._end(Message("master-gone"))
        self._report_split()
        self._report_trouble()

    def on_event(self, event: Event) -> None:
        """Record an event at its own time, however late it comes here on a busy machine."""
        late_ns = self._clock.wall_ns() - event.time_ns
        self._recorder.event(self._clock.monotonic_ns() - (late_ns if 0 < late_ns < LATEST_NS else 0), event)

    def _note_map(self, map_hash: str | None) -> None:
        """Keep the master's memory map in the session; one of another map than before begins a session of its own."""
        if map_hash in (None, self._map_hash):
            return
        try:
            if self._map_hash is not None:
                self.split()
        except NotNow:
            pass  # nothing is recorded
        except RecordingFailed:
            return  # it is tried again
        self._map_hash = map_hash
        self._recorder.memory_map(map_hash)

    def _master_received(self, t_mono_ns: int) -> None:
        first = self._last_good_ns is None
        self._last_good_ns = t_mono_ns
        if self._held_back or t_mono_ns < self._retry_ns or not (first or self._recorder_is_idle()):
            return
        with self._starting:  # each link calls in its own thread
            if self._recorder.status.session is None:
                self._start_by_itself(t_mono_ns)

    def _start_by_itself(self, t_mono_ns: int) -> None:
        try:
            self.start()
        except AppError as error:
            self.start_failure = error.message
            self._failing_ns = self._failing_ns or self._clock.wall_ns()
            self._retry_ns = t_mono_ns + int(RETRY_S * 1e9)
            if self._reported != error.message:
                self._reported = error.message
                self._on_event(self._event("recording-failed", error.message, "warning"))

    def _recorder_is_idle(self) -> bool:
        return self.status.session is None

    def _end(self, why: Message) -> SessionInfo | None:
        info = self._recorder.status.session
        if info is not None:
            self._recorder.stop()
            self._status = None
            self._on_event(self._event("recording-stopped", Message("recording-ended", session=info.id, why=why)))
        return info

    def _report_split(self) -> None:
        session = self.session
        with self._lock:
            is_news = session is not None and session.id != self._session_id
            self._session_id = None if session is None else session.id
        if is_news and session is not None:
            self._on_event(self._event("recording-split", Message("recording-goes-on", session=session.id)))

    def _event(self, code: str, message: Message, severity: Severity = "info") -> Event:
        return Event(self._clock.wall_ns(), severity, code, message)

    def _report_trouble(self) -> None:
        """Report each kind of trouble once, and when it is over; the numbers in its text change all the time."""
        status = self.status
        trouble = status.error or status.warning
        is_low = status.warning is not None and status.warning.code == "disk-low"
        kind = status.error.code if status.error else "low" if is_low else status.warning
        if kind == self._reported:
            return
        if trouble is not None:
            self._on_event(self._event("recording-trouble", trouble, "warning"))
        elif status.session is not None:
            lost = status.lost_items
            resumed = Message("recording-resumed-lost", n=lost) if lost else Message("recording-resumed")
            self._on_event(self._event("recording-resumed", resumed))
        self._reported = kind
