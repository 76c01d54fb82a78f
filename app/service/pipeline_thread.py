"""The pipeline's thread: takes what the links deliver out of the inbox, and hands on what the pipeline makes of it."""

import logging
import threading
from collections.abc import Callable, Sequence

from app.clock import Clock
from app.errors import NotNow
from app.estimation.errors import EstimatorError
from app.estimation.prediction.energy_target import RacePlan
from app.live.history import History
from app.live.hub import Hub
from app.live.load_shedding import LoadShedding, ShedLoad
from app.live.pipeline import Output, Pipeline
from app.live.trend import Trend
from app.service.failures import Failures
from app.service.inbox import Inbox
from app.sessions.replay import ReplayPlayer
from app.sources.items import Item
from app.telemetry import Snapshot
from app.telemetry.encoding import aged
from app.words import Message, Quantity

log = logging.getLogger(__name__)
TICK_S = 1.0  # without anything new there is a snapshot this often
STALL_S = 3 * TICK_S  # without a snapshot for so long, the pipeline stands still
STUCK_S = 60.0  # a thread that has worked on one item for so long does not come back
LATE_S = 2.0  # an item that has waited this long is worked on, but not always shown ...
LATE_SHOWN_S = 0.2  # ... only the newest in each of these times
SHED_SHOWN_S = 1.0  # where pages are left out for the recorder's sake, only the newest in each of these times
DRAIN_S = 2.0  # after the links were closed; what still waits then is recorded and not estimated any more
JOIN_S = 10.0
ItemListener = Callable[[Item], None]
OutputListener = Callable[[Output, int], None]  # with the monotonic time in ns


class PipelineThread:
    """The car's newest snapshot and its history; one thread works, any thread reads."""

    def __init__(
        self,
        pipeline: Pipeline,
        inbox: Inbox,
        hub: Hub[Snapshot],
        replay: ReplayPlayer,
        clock: Clock,
        *,
        on_item: Sequence[ItemListener],
        on_output: Sequence[OutputListener],
        failures: Failures | None = None,
        load: LoadShedding | None = None,
        after_publishing: Sequence[OutputListener] = (),
    ) -> None:
        """Prepare the thread.

        Args:
            pipeline: of the live source.
            inbox: what the links put their items into.
            hub: gets the car's snapshots while no replay is shown.
            replay: says whether one is shown.
            clock: for snapshots in which nothing is new but the ages.
            on_item: called with every item before the pipeline, in this order.
            on_output: called with everything the pipeline makes, in this order.
            failures: counts what went wrong; without it one of its own.
            load: says what to leave out; without it nothing is left out.
            after_publishing: called with what a new item led to, when the snapshot has gone out.
        """
        self.hub = hub
        self.history = History(pipeline.battery.n_cells)
        self.trend = Trend(pipeline.battery.n_cells)
        self.snapshot: Snapshot | None = None  # the car's, also while a replay is shown
        self._pipeline = pipeline
        self._inbox = inbox
        self._replay = replay
        self._clock = clock
        self._on_item = on_item
        self._on_output = (*on_output, self._keep_history)
        self._after_publishing = after_publishing
        self._failures = failures or Failures(clock)
        self._load = load
        self._drained_ns: int | None = None  # once it ends: only recorded from then on
        self._beat_ns: int | None = None  # when the thread last took or awaited an item, by the clock
        self._took_s = 0.0  # for the last item
        self._published_ns = 0  # by the items' time
        self._shown_ns = 0  # by the clock's
        self._thread = threading.Thread(target=self._run, name="pipeline", daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self) -> None:
        """Take no more items, work on those that are inside, end the thread.

        All of them are recorded, however many there are; those that cannot be worked on within DRAIN_S are not shown.
        """
        self._inbox.close()
        self._drained_ns = self._clock.monotonic_ns() + round(DRAIN_S * 1e9)
        if self._thread.is_alive():
            self._thread.join(timeout=JOIN_S)

    def warm_up(self) -> None:
        """Make the estimator ready before items come: compiling takes longer than they can wait."""
        try:
            self._pipeline.warm_up()
        except EstimatorError as error:
            log.warning("the estimator could not be started: %s", error)

    @property
    def n_cells(self) -> int:
        """Return the number of cells of the live battery."""
        return self._pipeline.battery.n_cells

    @property
    def source(self) -> str:
        """Return the source of the items."""
        return self._pipeline.source

    @property
    def can_rx_active(self) -> int | None:
        """Mask of the CAN rx messages that are alive."""
        return None if self.snapshot is None else self.snapshot.master.can_rx_active

    def voltage_age_s(self) -> float | None:
        """Return how old the car's newest cell voltages are [s]; None before the first."""
        return None if self.snapshot is None else aged(self.snapshot, self._clock.monotonic_ns()).age_s.voltage

    def mark_lap(self, ago_s: float) -> None:
        """The car crosses the line now, or did so long ago [s]: laps left counts with it."""
        self._pipeline.mark_lap(ago_s)

    def set_plan(self, plan: RacePlan | None) -> None:
        """Tell from now on what a lap may take; None: no more."""
        self._pipeline.set_plan(plan)

    def acknowledge_alarm(self, alarm_id: int, who: str) -> bool:
        """Mark an alarm as seen, False where there is none.

        Raises:
            NotNow: the alarms that are shown are a replay's.
        """
        if self._replay.is_active:
            raise NotNow(Message("alarms-of-replay"))
        return self._pipeline.acknowledge(alarm_id, who)

    def problems(self) -> list[Message]:
        """Return what is wrong with the pipeline; empty while all is well."""
        if self.snapshot is None:
            return [Message("no-snapshot")]
        failure = [] if self._failures.reason is None else [self._failures.reason]
        return self.silence() + failure

    def silence(self) -> list[Message]:
        """Return since when there is no snapshot; empty while there are, and before the first one."""
        if self.snapshot is None:
            return []
        silent_s = (self._clock.monotonic_ns() - self.snapshot.t_mono_ns) / 1e9
        return [Message("no-snapshot-for", time=Quantity(silent_s, "s", 0))] if silent_s > STALL_S else []

    def stuck(self) -> list[Message]:
        """Return since when the thread hangs in one item or has ended; one that is only late is not stuck."""
        if self._beat_ns is None:
            return []
        silent_s = (self._clock.monotonic_ns() - self._beat_ns) / 1e9
        return [Message("no-snapshot-for", time=Quantity(silent_s, "s", 0))] if silent_s > STUCK_S else []

    def _run(self) -> None:
        while not self._inbox.is_finished:
            self.step(TICK_S / 4)

    def step(self, timeout_s: float) -> None:
        """Work on the next item, wait for it so long; publish the ages where nothing was published for a second."""
        self._beat_ns = self._clock.monotonic_ns()
        due_ns = self._pipeline.due_ns
        if due_ns is not None:
            timeout_s = min(timeout_s, max(0.0, (due_ns - self._clock.monotonic_ns()) / 1e9))
        item = self._inbox.get(timeout_s)
        try:
            if item is not None:
                self._take(item)
            if self._is_ending:
                return
            # One time for items and ages: while items wait, now is the instant of the one that was taken
            now_ns = self._clock.monotonic_ns() if item is None else item.t_mono_ns
            is_due = item is None and due_ns is not None and now_ns >= due_ns
            if is_due or now_ns - self._published_ns >= TICK_S * 1e9:
                self._published_ns = now_ns
                wall_ns = self._clock.wall_ns() if item is None else item.t_wall_ns
                output = self._pipeline.tick(now_ns, wall_ns)
                self._hand_on(output, now_ns)
                if output.estimates is not None:
                    self._predict(output, now_ns)
        except Exception as error:  # noqa: BLE001  the supervisor: one item must not end the thread
            self._failures.add(error)

    @property
    def _is_ending(self) -> bool:
        """It ends, and there is no time left to work on what waits."""
        return self._drained_ns is not None and self._clock.monotonic_ns() >= self._drained_ns

    def _take(self, item: Item) -> None:
        for listener in self._on_item:
            try:
                listener(item)
            except Exception as error:  # noqa: BLE001  what fails here is estimated all the same
                self._failures.add(error)
        now_ns = self._clock.monotonic_ns()
        shed = ShedLoad.NOTHING
        if self._load is not None:
            shed = self._load.now((now_ns - item.t_mono_ns) / 1e9)
            self._load.shed(self._took_s)
        if self._is_ending:
            return  # the recorder has it
        shown_s = SHED_SHOWN_S if shed >= ShedLoad.PAGES else LATE_SHOWN_S
        is_late = shed >= ShedLoad.PAGES or now_ns - item.t_mono_ns > LATE_S * 1e9
        began_s = self._clock.monotonic_s()
        output = self._pipeline.feed(item, publishes=not is_late or now_ns - self._shown_ns >= shown_s * 1e9)
        self._hand_on(output, item.t_mono_ns)
        self._took_s = self._clock.monotonic_s() - began_s
        if output.snapshot is not None:
            self._published_ns, self._shown_ns = item.t_mono_ns, now_ns
            if shed < ShedLoad.PREDICTION:
                self._predict(output, item.t_mono_ns)

    def _predict(self, output: Output, t_mono_ns: int) -> None:
        self._pipeline.predict()
        self._call(self._after_publishing, output, t_mono_ns)

    def _hand_on(self, output: Output, t_mono_ns: int) -> None:
        snapshot = output.snapshot
        if snapshot is not None:
            self.snapshot = snapshot
        self._call(self._on_output, output, t_mono_ns)
        if snapshot is not None and not self._replay.is_active:
            self.hub.publish_threadsafe(snapshot)

    def _call(self, listeners: Sequence[OutputListener], output: Output, t_mono_ns: int) -> None:
        for listener in listeners:
            try:
                listener(output, t_mono_ns)
            except Exception as error:  # noqa: BLE001  if one fails, the others still run
                self._failures.add(error)

    def _keep_history(self, output: Output, t_mono_ns: int) -> None:
        if output.snapshot is not None:
            self.history.add(output.snapshot)
            self.trend.add(output.snapshot)
