"""Black boxes while the car runs: the last seconds are kept in memory, and written when the seconds after have passed.

Needs no recording. The pipeline's thread hands everything over and never waits; writing is done by a thread of its own.
"""

import contextlib
import logging
import threading
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from app.analysis.black_box.box import BlackBox
from app.analysis.black_box.excerpt import BoxWindow, build
from app.analysis.black_box.from_session import is_explained, store_box, with_cause
from app.analysis.incidents import AFTER_S, BEFORE_S, LONGEST_S, Trigger, follows, incidents, is_trigger
from app.analysis.limits import known_limits, limits_of
from app.analysis.root_cause.from_session import LATER_S, SETTLED_S, is_later_evidence
from app.analysis.root_cause.judge import Cause
from app.battery.battery import Battery
from app.errors import AppError
from app.live.pipeline import Output
from app.sessions.black_box_store import BlackBoxStore
from app.sessions.storage.own_database import OnSetAside, nobody_asks
from app.sources.loaded_battery import team_battery
from app.telemetry import Event, FloatArray, ProtectionLimits, Snapshot
from app.telemetry.cell_findings import Finding

log = logging.getLogger(__name__)
KEPT_S = BEFORE_S + LONGEST_S + AFTER_S + 2.0
BUSY_DISK = "not-written-within"  # what the cause is looked for in is not on the disk yet, after some seconds
TRIES = 12  # about a minute
SLACK_S = 0.2  # the sample after the last second counts too
CLOSE_S = 3.0  # for what is still to be written at the end, and for the cause that is being looked for then
MOST_TRIPS = 32  # whose cells are remembered
MOST_UNEXPLAINED = 12  # boxes that are looked at again
MAX_SAMPLES = 2000  # 50 Hz for so long, and some


@dataclass(frozen=True, slots=True)
class _Sample:
    mono_s: float
    current_a: float
    voltage_v: FloatArray
    temperature_degc: FloatArray
    soc: FloatArray
    fit: float
    load: float


@dataclass
class _Unexplained:
    """A box of which nothing is the cause yet; `due_s`: when it is looked for again, None: only by later evidence."""

    session_id: str
    group: Sequence[Trigger]
    box: BlackBox
    due_s: float | None


class BlackBoxRecorder:
    """Feeds on what the pipeline puts out; finished boxes go into the store."""

    def __init__(
        self,
        path: Path,
        session_id: Callable[[], str | None],
        on_made: Callable[[BlackBox], None],
        explain: Callable[[str, Sequence[Trigger]], Cause | None] = lambda session_id, group: None,
        *,
        is_simulated: bool = False,
        battery: Battery | None = None,
        on_set_aside: OnSetAside = nobody_asks,
    ) -> None:
        """Write into the file at `path`.

        Args:
            path: of the store.
            session_id: what is being recorded.
            on_made: called with every box, by the writing thread.
            explain: judges an incident in the session that is being recorded; AppError where it cannot be read.
            is_simulated: the car is the simulator.
            battery: whose cells these are; None: the team's own.
            on_set_aside: called where the store was damaged and set aside.

        Raises:
            AppError: the file cannot be used.
        """
        self.lost = threading.Event()  # those of earlier runs

        def set_aside(damaged: Path, kept: Path) -> None:
            self.lost.set()
            on_set_aside(damaged, kept)

        self.store = BlackBoxStore(path, set_aside)
        self._session_id = session_id
        self._is_simulated = is_simulated
        self._battery = battery or team_battery().battery
        self._on_made = on_made
        self._explain = explain
        self._samples: deque[_Sample] = deque(maxlen=MAX_SAMPLES)
        self._triggers: list[Trigger] = []
        self._trips: deque[Trigger] = deque(maxlen=MOST_TRIPS)
        self._findings: tuple[Finding, ...] = ()
        self._limits: ProtectionLimits | None = None  # those that the first trigger was judged by
        self._session: str | None = None
        self._config: tuple[bytes, str | None] | None = None
        self._unexplained: deque[_Unexplained] = deque(maxlen=MOST_UNEXPLAINED)
        self._is_closing = self._is_late = False
        self._writer = ThreadPoolExecutor(max_workers=1, thread_name_prefix="blackbox")

    def on_output(self, output: Output, t_mono_ns: int) -> None:
        """Take what one item led to, and write what is complete."""
        now_s, snapshot = t_mono_ns / 1e9, output.snapshot
        for event in output.events:
            trigger = _trigger(event, now_s)
            if is_trigger(event.severity, event.code) and (self._triggers or not follows(trigger, self._trips)):
                self._session = self._session_id() if not self._triggers else self._session
                self._triggers.append(trigger)
                if event.severity == "trip":
                    self._trips.append(trigger)
        if snapshot is not None:
            self._findings = snapshot.findings
            self._limits = snapshot.limits if not self._triggers else self._limits or snapshot.limits
        if snapshot is not None and snapshot.is_fresh:
            self._samples.append(_sample(snapshot))
            while self._samples and now_s - self._samples[0].mono_s > KEPT_S:
                self._samples.popleft()
            if snapshot.config is not None and not self._triggers:
                self._config = snapshot.config, snapshot.config_hash
        if self._triggers and (
            now_s - self._triggers[-1].mono_s >= AFTER_S + SLACK_S
            or now_s - self._triggers[0].mono_s >= LONGEST_S + AFTER_S
        ):
            self._finish()
        self._recheck(output, now_s)

    def close(self) -> None:
        """Write what there is of an incident under way, and close the store.

        What is not written within some seconds is left to its session, which has all that the box needs; without a
        recording the box is written without a cause.
        """
        self._is_closing = True
        if self._triggers:
            self._finish()
        with contextlib.suppress(TimeoutError, RuntimeError):  # closed already
            self.wait(CLOSE_S)
        self._is_late = True
        self._writer.shutdown(wait=True)
        self.store.close()

    def wait(self, timeout_s: float | None = None) -> None:
        """Wait until the incidents that are over have their boxes.

        Raises:
            TimeoutError: so long was not enough.
            RuntimeError: the store was closed.
        """
        self._writer.submit(int).result(timeout_s)

    def _finish(self) -> None:
        triggers, self._triggers = self._triggers, []
        image, config_hash = self._config or (None, None)
        limits = limits_of(image) or known_limits(self._limits)
        arguments = (triggers, list(self._samples), self._session, limits, config_hash, self._findings)
        with contextlib.suppress(RuntimeError):  # shutting down
            self._writer.submit(self._write, *arguments).add_done_callback(_report_failure)

    def _write(
        self,
        triggers: list[Trigger],
        samples: list[_Sample],
        session_id: str | None,
        limits: dict[str, float],
        config_hash: str | None,
        findings: tuple[Finding, ...],
    ) -> None:
        for group in incidents(triggers):
            if self._is_late and session_id is not None:
                return
            window = _window(samples, group[0].mono_s - BEFORE_S, group[-1].mono_s + AFTER_S)
            box = build(
                group,
                window,
                session_id=session_id,
                config_hash=config_hash,
                limits=limits,
                is_simulated=self._is_simulated,
                segments=self._battery.segments,
            )
            cause, was_judged = self._verdict(session_id, group)
            box = with_cause(box, cause, findings)
            self._keep(box)
            if session_id is not None and not is_explained(box) and (cause is not None or not was_judged):
                due_s = group[-1].mono_s + SETTLED_S + LATER_S
                self._unexplained.append(_Unexplained(session_id, group, box, due_s))

    def _keep(self, box: BlackBox, *, revises: bool = False) -> None:
        try:
            if store_box(self.store, box, revises=revises):
                self._on_made(box)
        except AppError as error:
            log.warning("a black box was not written: %s", error)

    def _recheck(self, output: Output, now_s: float) -> None:
        """Look again for the cause of what is unexplained: once some time later, and by what is found of its cell."""
        for unexplained in list(self._unexplained):
            is_evidence = any(
                is_later_evidence(event.code, event.cell, unexplained.box.cell) for event in output.events
            )
            if is_evidence or (unexplained.due_s is not None and now_s >= unexplained.due_s):
                unexplained.due_s = unexplained.due_s if is_evidence else None
                with contextlib.suppress(RuntimeError):  # shutting down
                    self._writer.submit(self._revise, unexplained, self._findings).add_done_callback(_report_failure)

    def _revise(self, unexplained: _Unexplained, findings: tuple[Finding, ...]) -> None:
        cause, _ = self._verdict(unexplained.session_id, unexplained.group)
        box = with_cause(unexplained.box, cause, findings)
        if is_explained(box) and unexplained in self._unexplained:
            self._unexplained.remove(unexplained)
            self._keep(box, revises=True)

    def _verdict(self, session_id: str | None, group: Sequence[Trigger]) -> tuple[Cause | None, bool]:
        """Return the cause, None where there is nothing to be explained; False: it could not be looked for."""
        if session_id is None:
            return None, False
        for left in reversed(range(TRIES)):
            try:
                return self._explain(session_id, group), True
            except AppError as error:
                if left and not self._is_closing and error.message.code == BUSY_DISK:
                    continue
                log.warning("the cause of a trip was not evaluated: %s", error)
            except Exception:  # whatever is wrong with the search, the box is kept
                log.exception("the search for the cause of a trip failed")
            break
        return None, False


def _report_failure(done: "Future[None]") -> None:
    if not done.cancelled() and (error := done.exception()) is not None:
        log.error("a black box could not be made", exc_info=error)


def _trigger(event: Event, mono_s: float) -> Trigger:
    return Trigger(
        event.time_ns / 1e9,
        mono_s,
        event.code,
        event.severity,
        event.message,
        event.cell,
        event.value,
        event.limit,
        event.unit,
    )


def _sample(snapshot: Snapshot) -> _Sample:
    flags, current_a = snapshot.master.flags, snapshot.accumulator.current_a
    load = None if flags is None else flags.load
    cells = snapshot.cells
    return _Sample(
        snapshot.t_mono_ns / 1e9,
        np.nan if current_a is None else current_a,
        cells.voltage_v,
        cells.temperature_degc,
        cells.soc,
        np.nan if flags is None else float(flags.fit),
        np.nan if load is None else float(load),
    )


def _window(samples: list[_Sample], first_s: float, last_s: float) -> BoxWindow:
    chosen = [sample for sample in samples if first_s <= sample.mono_s <= last_s]
    n_cells = len(samples[0].voltage_v) if samples else 0

    def column(name: str) -> FloatArray:
        return np.array([getattr(sample, name) for sample in chosen], dtype=np.float64)

    def table(name: str) -> FloatArray:
        rows = [getattr(sample, name) for sample in chosen]
        return np.array(rows, dtype=np.float64) if rows else np.empty((0, n_cells))

    return BoxWindow(
        mono_s=column("mono_s"),
        current_a=column("current_a"),
        voltage_v=table("voltage_v"),
        temperature_degc=table("temperature_degc"),
        soc=table("soc"),
        fit=column("fit"),
        load=column("load"),
    )
