"""Items in, snapshots out: source, estimator, alarms, in one place and one order. No I/O; time comes with items.

ReplayPlayer recorded items through a fresh Pipeline gives the same snapshots again.
"""

import threading
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from app.battery.battery import Battery
from app.estimation.errors import EstimatorError
from app.estimation.filters.estimators import Estimates, SocEstimator
from app.estimation.filters.first_minutes import FirstMinutes
from app.estimation.prediction.constant_current import Limits
from app.estimation.prediction.driver_soc import DriverSoc
from app.estimation.prediction.energy_target import RacePlan
from app.estimation.recording.gaps import SHORT_GAP_S, Gap, GapWatch
from app.live.accumulator import EnergyCount, LowestOfDrive, accumulator_of, total_voltage
from app.live.alarms import AlarmTracker, FindingChanges
from app.live.cells import cells_of, packs_of, with_findings
from app.live.estimator_start import start_estimator
from app.live.last_known import LastValues
from app.live.plausibility import PlausibilityChecks
from app.live.prediction import Assessment, Predictor
from app.live.prediction_conditions import as_of
from app.live.remembered_charge import MasterCount, RememberedCharge
from app.sources.items import Item
from app.sources.source import NOTHING_RECEIVED, MeasurementSource
from app.telemetry import Alarm, Estimator, Event, FloatArray, ProtectionLimits, Snapshot, Source, TripCause
from app.telemetry.cell_findings import agreeing
from app.telemetry.measurement import BLANK_S, Measurement
from app.words import Message

MIN_CURRENT_LIMIT_A = 1.0
SAME_V = 0.02  # cells that read what they should by so much are the same, and at the same charge
UNKNOWN_SOC = 0.5  # sigma of a SOC of which nothing is known
MAX_ENERGY_STEP_S = 10.0  # what flowed in a longer gap is not known, and not made up


@dataclass(frozen=True, slots=True)
class Output:
    """Results of one item."""

    snapshot: Snapshot | None = None
    events: tuple[Event, ...] = ()
    estimates: Estimates | None = None  # where this item made the estimator step
    uptime_ms: int = 0
    t_mono_ns: int = 0  # time of the estimates

    @property
    def is_nothing(self) -> bool:
        """The item led to nothing."""
        return self is _NOTHING


_NOTHING = Output()


class Pipeline:
    """One source's chain. `feed` and `tick` are called from one thread; `acknowledge` from any."""

    def __init__(
        self,
        source: MeasurementSource,
        make_estimator: Callable[[], SocEstimator],
        *,
        filter_name: str,
        cell_name: str,
        stopwatch_ns: Callable[[], int] | None = None,
        predictor: Predictor | None = None,
        remembered: RememberedCharge | None = None,
        alarms: tuple[Alarm, ...] = (),
    ) -> None:
        self._source = source
        self._make_estimator = make_estimator
        self._estimator: SocEstimator | None = None
        self._spare: SocEstimator | None = None
        self._skipped = 0  # measurements without a current, without any voltage, or on which the estimator failed
        self.filter_name, self.cell_name = filter_name, cell_name
        self._watch = AlarmTracker(alarms)  # those that were open in an earlier run
        self._watch_lock = threading.Lock()
        self._news = FindingChanges()
        self._driver = DriverSoc(source.battery.n_cells)
        self._plausibility = PlausibilityChecks(source.battery)
        self._estimates: Estimates | None = None
        self._sequence = 0
        self._driver_percent: int | None = None
        self._energy = EnergyCount()
        self._last = LastValues(source.battery.n_cells, len(source.battery.segments))
        self._drive = LowestOfDrive()
        self._stopwatch_ns = stopwatch_ns
        self._predictor = predictor
        self._remembered = remembered  # charge from before a restart or a silence
        self._limits: ProtectionLimits | None = None
        self._measured: tuple[float, FloatArray, int] | None = None  # current, temperatures, time: not yet judged
        self._judged_ns: int | None = None  # time of what the prediction was judged by
        self._step_us: float | None = None
        self._estimator_error: str | None = None
        self._gaps = GapWatch()
        self._first_minutes = FirstMinutes()
        self._started_with: tuple[Measurement, float] | None = None
        self._stepped: Measurement | None = None  # with which the estimator last stepped

    def warm_up(self) -> None:
        """Make the estimator before it is needed: compiling it takes longer than frames can wait. From any thread."""
        self._spare = self._make_estimator()

    def feed(self, item: Item, *, publishes: bool = True) -> Output:
        """Take one item from a link; without `publishes` the estimator steps, and no snapshot is made of it."""
        received = self._source.feed(item)
        if received is NOTHING_RECEIVED:
            return _NOTHING
        if received.measurement is None:
            return Output(events=received.events)
        return self._take(received.measurement, publishes=publishes)

    def tick(self, t_mono_ns: int, t_wall_ns: int) -> Output:
        """Return a snapshot in which nothing is new but the ages."""
        return self._take(self._source.measure(t_mono_ns, t_wall_ns))

    @property
    def due_ns(self) -> int | None:
        """Return when to call `tick` although no item comes [ns]; None: nothing waits."""
        return self._source.due_ns

    @property
    def battery(self) -> Battery:
        """Return the battery of the snapshots."""
        return self._source.battery

    @property
    def source(self) -> Source:
        """Return the source of the items."""
        return self._source.name

    @property
    def estimates(self) -> Estimates | None:
        """The estimator's latest."""
        return self._estimates

    @property
    def charge(self) -> RememberedCharge | None:
        """Return the SOC of the cells to start from after a restart."""
        estimates, measured = self._estimates, self._stepped
        if estimates is None or measured is None:
            return None
        return RememberedCharge(measured.t_wall_ns, estimates.soc, estimates.soc_sigma, MasterCount.of(measured))

    def mark_lap(self, ago_s: float = 0.0) -> None:
        """The car crosses the line now, or did so long ago [s]. From any thread."""
        if self._predictor is not None:
            self._predictor.mark_lap(ago_s)

    def set_plan(self, plan: RacePlan | None) -> None:
        """Tell from now on what a lap may take; None: no more. From any thread."""
        if self._predictor is not None:
            self._predictor.set_plan(plan)

    def predict(self) -> None:
        """Judge what lies ahead, for the next snapshot; call it when the last one has gone out."""
        if self._predictor is None or self._measured is None or self._estimator is None or self._estimates is None:
            return
        current_a, temperatures_degc, t_mono_ns = self._measured
        self._measured = None
        limits = self._power_limits()
        if self._predictor.assess(self._estimator, self._estimates, temperatures_degc, current_a, limits):
            self._judged_ns = t_mono_ns
        self._predictor.apply_learned(self._estimator)
        self._estimate_again(self._predictor)

    def _estimate_again(self, predictor: Predictor) -> None:
        """Estimate the first minutes again once driving has shown the resistances of the cells."""
        if self._started_with is None:
            return
        measured, current_a = self._started_with

        def restart() -> SocEstimator:
            estimator = self._make_estimator()
            predictor.apply_learned(estimator)
            start_estimator(estimator, measured, current_a, self._remembered)
            return estimator

        restarted = self._first_minutes.again(predictor.factors_in_use, predictor.learned.has_resistance, restart)
        if restarted is not None:
            self._estimator, self._estimates = restarted

    def _power_limits(self) -> Limits:
        """Limits of the configuration or of the profile; the cell's own where one is missing."""
        given = self._limits
        if given is None:
            return Limits()
        limits = {
            "v_min_v": given.cell_voltage_min_v,
            "v_max_v": given.cell_voltage_max_v,
            "discharge_max_a": max(given.discharge_max_a, MIN_CURRENT_LIMIT_A),
            "charge_max_a": max(-given.discharge_min_a, MIN_CURRENT_LIMIT_A),
            "temperature_max_degc": given.temperature_max_degc,
        }
        return Limits(**{name: limit for name, limit in limits.items() if not np.isnan(limit)})

    def acknowledge(self, alarm_id: int, who: str) -> bool:
        """Mark an alarm as seen."""
        with self._watch_lock:
            return self._watch.acknowledge(alarm_id, who)

    def explain(self, cause: TripCause, at_ns: int | None = None) -> None:
        """Set what caused the trips of an incident, by its wall time; None: those that hold. From any thread."""
        with self._watch_lock:
            self._watch.explain(cause, at_ns)

    def name(self, causes: tuple[TripCause, ...]) -> None:
        """Set what is wrong without having tripped anything, by what was recorded. From any thread."""
        with self._watch_lock:
            self._watch.name(causes)

    def _take(self, measured: Measurement, *, publishes: bool = True) -> Output:
        estimates: Estimates | None = None
        events: tuple[Event, ...] = ()
        self._limits = measured.limits
        if measured.is_sample:
            estimates, events = self._step(measured)
            self._skipped += estimates is None
        output = self._publish(measured) if publishes else Output()
        events += output.events
        return Output(output.snapshot, events, estimates, measured.uptime_ms or 0, measured.t_mono_ns)

    def _step(self, measured: Measurement) -> tuple[Estimates | None, tuple[Event, ...]]:
        """Put a sample through everything that has a memory."""
        current_a, dt_s = measured.current_a, measured.dt_s
        if current_a is None or np.isnan(measured.voltage_v).all():
            return None, ()
        voltages_v = measured.filter_voltage_v
        true_a = current_a if self._predictor is None else current_a - self._predictor.offset_a
        estimates, events = self._estimate(measured, dt_s, true_a)
        self._drive.step(measured.t_mono_ns, measured.t_wall_ns, current_a, measured.new_voltage_v)
        cells_v = measured.voltage_v
        total_v = total_voltage(cells_v, measured.reported) if np.isnan(cells_v).any() else float(cells_v.sum())
        # laps are compared with each other: a missing cell counts as the mean of the others
        power_w = current_a * (float(np.nanmean(cells_v)) * cells_v.size if total_v is None else total_v)
        is_whole = measured.is_new is None or bool(measured.is_new.all())  # else voltages of other currents are in it
        self._plausibility.step(dt_s if is_whole else None, current_a, cells_v, measured.chip_voltage_v)
        if self._predictor is not None:
            degc = measured.temperature_degc
            time_s, balancing = measured.t_wall_ns / 1e9, measured.balancing
            self._predictor.step(
                dt_s, current_a, voltages_v, power_w, estimates, degc, measured.relays_open, time_s, balancing
            )
            self._measured = current_a, degc, measured.t_mono_ns
        if dt_s is not None and dt_s <= MAX_ENERGY_STEP_S:
            self._energy.step(dt_s, current_a, cells_v, total_v)
        return estimates, events

    def _estimate(
        self, measured: Measurement, dt_s: float | None, current_a: float
    ) -> tuple[Estimates | None, tuple[Event, ...]]:
        """Step the estimator; one that fails is restarted at the next measurement, with one event."""
        started_ns = self._stopwatch_ns() if self._stopwatch_ns else 0
        voltages_v, degc = measured.filter_voltage_v, measured.temperature_degc
        try:
            if dt_s is None and self._stepped is not None:  # the master was reset, or silent for long
                dt_s = max(measured.t_mono_ns - self._stepped.t_mono_ns, 0) / 1e9
            dt_s = dt_s or 0.0
            if self._estimator is not None:
                dt_s = self._go_on(self._estimator, measured, dt_s, current_a)
            if self._estimator is None:
                estimator, self._spare = self._spare or self._make_estimator(), None
                factors: FloatArray | float = 1.0
                if self._predictor is not None:
                    self._predictor.apply_learned(estimator)
                    factors = self._predictor.factors_in_use
                start_estimator(estimator, measured, current_a, self._remembered)
                self._started_with, self._first_minutes = (measured, current_a), FirstMinutes(factors)
                self._estimator, dt_s = estimator, 0.0
            self._stepped = measured
            self._first_minutes.keep(dt_s, current_a, voltages_v, degc)
            self._estimates = self._estimator.step(dt_s, current_a, voltages_v, degc)
        except (EstimatorError, ArithmeticError, ValueError) as error:
            self._remembered = self.charge or self._remembered
            self._estimator = self._estimates = None
            is_news, self._estimator_error = self._estimator_error is None, str(error)
            message = Message("estimator-failed", error=str(error))
            event = Event(measured.t_wall_ns, "warning", message.code, message)
            return None, (event,) if is_news else ()
        self._estimator_error = None
        self._driver_percent = self._driver.step(self._estimates.known_soc(measured.voltage_v)).percent
        if self._stopwatch_ns and dt_s:
            took_us = (self._stopwatch_ns() - started_ns) / 1000
            self._step_us = took_us if self._step_us is None else self._step_us + 0.02 * (took_us - self._step_us)
        return self._estimates, ()

    def _go_on(self, estimator: SocEstimator, measured: Measurement, dt_s: float, current_a: float) -> float:
        """Bridge a gap before this measurement; return what is left of the step [s].

        Where anything may have happened meanwhile and a cell reads otherwise than it should, or the master was without
        power for long, the estimator is to be started again from what is remembered.
        """
        is_off = measured.was_off
        capacity_ah = estimator.capacity()[0] if is_off or self._gaps.is_gap(dt_s) else np.ones(1)
        gap = self._gaps.step(dt_s, current_a, float(capacity_ah.mean()))
        if (gap is None and not is_off) or (charge := self.charge) is None:
            return dt_s
        self._first_minutes.drop()
        voltages_v, degc = measured.filter_voltage_v, measured.temperature_degc
        left_s, nothing = min(self._gaps.usual_step_s, dt_s), np.full_like(voltages_v, np.nan)
        is_sure = not is_off
        if gap is None or is_off:
            gap = Gap(current_a, 0.0)
        elif dt_s > SHORT_GAP_S or charge.drawn_ah(measured, dt_s) is not None:
            charge = charge.after(gap, dt_s, float(capacity_ah.mean()))
            is_sure = charge.drawn_ah(measured, dt_s) is not None
            gap = charge.gap(measured, dt_s, capacity_ah, estimator.tuning)
        if not is_off or dt_s <= BLANK_S:
            estimator.step(dt_s - left_s, gap.current_a, nothing, degc)
            estimator.widen(np.minimum(gap.sigma_ah / capacity_ah, UNKNOWN_SOC))
            if is_sure:
                return left_s
            predicted_v = estimator.step(left_s, current_a, nothing, degc).voltage_v
            if np.nanmax(np.abs(voltages_v - predicted_v)) < SAME_V:
                return 0.0
        self._remembered, self._estimator = charge, None
        return 0.0

    def _publish(self, measured: Measurement) -> Output:
        age_s = measured.age_s.voltage
        estimates = self._estimates if age_s is not None and age_s <= BLANK_S else None
        assessment = Assessment()
        if self._predictor is not None and estimates is not None:
            assessment = self._predictor.assessment
        cells = cells_of(measured, estimates, assessment)
        self._sequence += 1
        snapshot = Snapshot(
            sequence=self._sequence,
            t_mono_ns=measured.t_mono_ns,
            t_wall_ns=measured.t_wall_ns,
            uptime_s=None if measured.uptime_ms is None else measured.uptime_ms / 1000,
            source=self.source,
            age_s=measured.age_s,
            cells=cells,
            packs=packs_of(self.battery, cells, measured.slave_status),
            accumulator=accumulator_of(cells, measured, self._driver_percent, self._energy, self._drive.lowest),
            prediction=as_of(assessment.prediction, measured, self._judged_ns),
            findings=() if self._predictor is None else self._predictor.findings,
            master=measured.master,
            charger=measured.charger,
            links=measured.links,
            estimator=self._estimator_state(),
            plausibility=self._plausibility.verdicts(
                cells, measured.reported.voltage_v, measured.reported.voltage_error
            ),
            config_hash=measured.config_hash,
            limits=measured.limits,
            config=measured.config,
            disagreements=measured.disagreements,
            is_fresh=measured.is_fresh,
            live_s=measured.live_s,
            awaited=measured.awaited,
            segments=self.battery.segments,
        )
        snapshot = replace(snapshot, last_known=self._last.step(snapshot))
        news = self._news.step(snapshot)
        with self._watch_lock:
            findings = agreeing(snapshot.findings, self._watch.causes(snapshot.findings))
            snapshot = replace(snapshot, findings=findings, cells=with_findings(snapshot.cells, findings))
            alarms, events = self._watch.step(snapshot)
        return Output(replace(snapshot, alarms=alarms), (*events, *news))

    def _estimator_state(self) -> Estimator:
        sensor = None if self._predictor is None else self._predictor.sensor
        return Estimator(
            filter=self.filter_name,
            cell=self.cell_name,
            step_us=self._step_us,
            started=self._estimator is not None,
            skipped=self._skipped,
            current_offset_a=sensor.offset_a if sensor is not None and sensor.is_observed else None,
            current_offset_sigma_a=None if sensor is None else sensor.sigma_a,
            resistance_age_s=None if self._predictor is None else self._predictor.resistance_age_s,
        )
