"""Prediction: power, time to the limits, energy and laps left; loose joints and capacities. Time is an argument.

`step` takes every measurement and is cheap; `assess` does the rest, at most once a second, after the snapshot has gone
out. It feeds app.estimation and knows no equation itself.
"""

from collections import deque
from dataclasses import dataclass, replace
from math import exp, isfinite

import numpy as np

from app.estimation.cell_model.circuit import CellModel
from app.estimation.filters.estimators import Estimates, SocEstimator
from app.estimation.filters.tuning import Tuning
from app.estimation.health.capacity import CapacityBetweenRests, CapacityTracker, StateOfHealth, state_of_health
from app.estimation.health.cell_watch import JUDGE_S, CellWatch, CellWatchMemory
from app.estimation.health.joints import JointReport
from app.estimation.health.learned import Learned, learned
from app.estimation.health.resistance_scale import ResistanceScale, filter_factor
from app.estimation.health.sensor_offset import OffsetTracker
from app.estimation.prediction.calibration import VoltageForecast
from app.estimation.prediction.constant_current import CellKnowledge, Limits, OperatingPoint
from app.estimation.prediction.energy import EnergyLeft, LapsLeft, energy_left, laps_left
from app.estimation.prediction.energy_target import EnergyTarget, EnergyTargetStore, RacePlan
from app.estimation.prediction.heat import HeatBalance
from app.estimation.prediction.laps import LapWatch
from app.estimation.prediction.power import COVERAGE, PowerModel, StatePower, TimeToTrip
from app.live.prediction_conditions import (
    at_load,
    beyond_temperatures,
    cells_unknown,
    laps_known,
    power_held,
    until_empty,
)
from app.telemetry import BoolArray, CountedWith, FloatArray, Prediction
from app.telemetry.cell_findings import Finding, Sensors, findings_in_words

ASSESS_S = 1.0
UNKNOWN_S = 10.0  # what flowed in a longer gap is not known
DRIVING_A = 2.0
DRIVING_MEMORY_S = 300.0  # memory of the driving current: four or five laps
LOAD_S = 10.0  # time constant of the load that the next limit is predicted for: throttle and brake alternate
RESTING_A = 1.0  # load without direction: no limit comes nearer


@dataclass(frozen=True)
class Assessment:
    """The latest judgement; None where there is not enough to judge."""

    power: StatePower | None = None
    to_trip: tuple[TimeToTrip, ...] = ()  # at the present current
    to_trip_full: tuple[TimeToTrip, ...] = ()  # at the full discharge current
    energy: EnergyLeft | None = None
    laps: LapsLeft | None = None
    target: EnergyTarget | None = None  # None without a plan
    joints: JointReport | None = None
    loose: BoolArray | None = None  # confirmed
    health: StateOfHealth | None = None
    capacity_ah: FloatArray | None = None
    learned: Learned | None = None  # what power, times, energy and laps were counted with
    prediction: Prediction | None = None  # the above that is not per cell, as the API shows it


@dataclass(frozen=True)
class LearnedCells:
    """Results of earlier sessions about the cells."""

    capacity_state: FloatArray  # (6, n_cells), of CapacityTracker
    joint_baseline_ohm: FloatArray  # (n_cells,), of JointWatch
    resistance: FloatArray | None = None  # (2, n_cells), factor and sigma of ResistanceScale
    watch: CellWatchMemory | None = None  # memory of CellWatch; the baseline above is its own


class Predictor:
    """Keeps what has to be remembered between two assessments."""

    def __init__(
        self,
        cell: CellModel,
        segments: tuple[int, ...],
        learned_before: LearnedCells | None = None,
        *,
        watch: CellWatch | None = None,
        sensors: Sensors | None = None,
        predicts: bool = True,
    ) -> None:
        """Start, or go on with what was learned before.

        Args:
            cell: model of every cell.
            segments: cells of each.
            learned_before: by earlier sessions.
            watch: has watched these cells up to now.
            sensors: of each temperature sensor the cells that it stands for; None: one a cell.
            predicts: whether power, energy and times to the limits are wanted; nothing that is learned, found or
                alarmed about depends on them.
        """
        n_cells = sum(segments)
        self.cell = cell
        self.assessment = Assessment()
        before = learned_before
        self._watch = watch or CellWatch(cell, segments, _watched_before(before))
        self._sensors = sensors
        self._predicts = predicts
        self.findings = self._found()
        capacities = CapacityTracker(cell.capacity_ah, n_cells, None if before is None else before.capacity_state)
        self._capacities = CapacityBetweenRests(cell, capacities)
        self._scale = ResistanceScale(n_cells, None if before is None else before.resistance)
        self.learned = self._learned()
        self._factors_in_use = np.ones(n_cells)  # resistance factors that the estimator counts with
        self._offset = OffsetTracker(float(self.learned.capacity_ah.mean()))
        self._is_measured = True  # the cells' temperatures are those the model was made at
        self._tuning = Tuning()
        self._needs_voltage_soc = False  # voltages, to compare the current with
        self.sensor = self._offset.estimate()
        self._laps = LapWatch()
        self._unknown_cells = 0  # without an SOC
        self._marks: deque[float] = deque()  # seconds since crossings of the line that the lap counter has not yet seen
        self._target = EnergyTargetStore()
        self._plans: deque[RacePlan | None] = deque()  # new plans that the lap counter has not yet seen
        self._t_s = self._flow_a = 0.0  # time of all samples [s], mean size of the current [A]
        self._assessed_s = self._judged_s = -1e9
        self._driven = (0.0, 0.0, 0.0)  # fading sums of time, current and its square while driving [s], [A s], [A^2 s]
        self._forecast = VoltageForecast(cell)
        self._heat = HeatBalance(Limits().heat_capacity_j_k)
        self._load_a: float | None = None  # mean of the last seconds
        self._joints: JointReport | None = None
        self._health: StateOfHealth | None = None
        self._capacity_ah: FloatArray | None = None

    @property
    def offset_a(self) -> float:
        """Return the offset to take off the measured current [A]; 0 where it is not observable."""
        return self.sensor.offset_a if self.sensor.is_observed else 0.0

    @property
    def resistance_age_s(self) -> float | None:
        """Seconds since current last showed the resistances; None before it did."""
        age_s = self._watch.resistance_age_s
        return age_s if isfinite(age_s) else None

    @property
    def learned_cells(self) -> LearnedCells:
        """Return the results to keep for the next session of the same cells."""
        resistance = np.array(self._scale.judge())
        watched = self._watch.memory
        return LearnedCells(self._capacities.tracker.state, watched.joint_baseline_ohm, resistance, watched)

    def mark_lap(self, ago_s: float = 0.0) -> None:
        """The car crosses the line now, or did so long ago [s]. From any thread."""
        self._marks.append(ago_s)

    def set_plan(self, plan: RacePlan | None) -> None:
        """Work out from now on what a lap may take; None: no more. From any thread."""
        self._plans.append(plan)

    @property
    def factors_in_use(self) -> FloatArray:
        """(n_cells,) resistances over those of the cell file that the estimator predicts with."""
        return self._factors_in_use

    def apply_learned(self, estimator: SocEstimator) -> None:
        """Let an estimator count with what was learned of its cells."""
        self._factors_in_use = filter_factor(self.learned.resistance_factor, self.learned.has_resistance)
        estimator.use_capacity(self.learned.capacity_ah)
        estimator.use_resistance(self._factors_in_use)

    def step(
        self,
        dt_s: float | None,
        current_a: float,
        voltages_v: FloatArray,
        power_w: float,
        estimates: Estimates | None,
        temperatures_degc: FloatArray,
        relays_open: bool = False,
        time_s: float | None = None,
        balancing: BoolArray | None = None,
    ) -> None:
        """Take one measurement, with its estimates, if any.

        Args:
            dt_s: since the one before; None = not known [s].
            current_a: measured, positive on discharge [A].
            voltages_v: (n_cells,) [V]; NaN = missing.
            power_w: of the accumulator, positive on discharge [W].
            estimates: of this measurement, by an estimator that `apply_learned` was called for.
            temperatures_degc: (n_cells,) [degC]; NaN = missing.
            relays_open: no current can flow.
            time_s: when it was measured, unix time; None = a clock of its own [s].
            balancing: (n_cells,) cells that are bled; None = not known.
        """
        if dt_s is None or dt_s > UNKNOWN_S:
            self._offset.interrupt()
        dt_s = dt_s or 0.0
        self._needs_voltage_soc |= self._offset.step(dt_s, current_a, relays_open)
        self._t_s += dt_s
        self._flow_a += (1.0 - exp(-dt_s / self._tuning.wander_s)) * (abs(current_a) - self._flow_a)
        if estimates is not None:
            if self._flow_a > self._tuning.rest_c * self.cell.capacity_ah:  # at rest a filter settles: no drop moves it
                self._scale.step(dt_s, estimates, self._factors_in_use, self._where_measured(voltages_v))
            self._unknown_cells = int(np.isnan(estimates.known_soc(voltages_v)).sum())
            self._heat.step(dt_s, (estimates.ocv_v - estimates.voltage_v) * current_a, temperatures_degc)
        self._watch.step(
            self._t_s if time_s is None else time_s, dt_s, current_a, voltages_v, temperatures_degc, balancing
        )
        before = current_a if self._load_a is None else self._load_a
        self._load_a = before + min(1.0, dt_s / LOAD_S) * (current_a - before)
        if abs(current_a) > DRIVING_A:
            fade = np.exp(-dt_s / DRIVING_MEMORY_S)
            time, charge, square = self._driven
            moved = current_a * dt_s
            self._driven = fade * time + dt_s, fade * charge + moved, fade * square + current_a * moved
        self._forecast.step(dt_s, current_a - self.offset_a, voltages_v)
        self._laps.step(dt_s, power_w)
        while self._marks:
            self._laps.mark(self._marks.popleft())
        while self._plans:
            self._target.set(self._plans.popleft(), self._laps)
        self._capacities.step(dt_s, current_a, self._where_measured(voltages_v))

    def _where_measured(self, voltages_v: FloatArray) -> FloatArray:
        """Return the voltages, NaN while the cells are too cold or too hot for their model: nothing is learned then."""
        return voltages_v if self._is_measured else np.full_like(voltages_v, np.nan)

    def assess(
        self,
        estimator: SocEstimator,
        estimates: Estimates,
        temperatures_degc: FloatArray,
        current_a: float,
        limits: Limits,
    ) -> bool:
        """Judge anew if a second has passed; True when that was done."""
        if self._t_s - self._assessed_s < ASSESS_S:
            return False
        self._assessed_s = self._t_s
        if not np.isfinite(estimates.soc).any():
            self.assessment = Assessment()
            return True
        degc = temperatures_degc[np.isfinite(temperatures_degc)]
        self._is_measured = not degc.size or float(self.cell.drop_error(degc).max()) < self._tuning.drop_error_max
        is_valid = estimates.model_valid.mean() > 0.5  # a model that is not valid says nothing of the sensor
        if self._needs_voltage_soc and is_valid and (voltage_soc := estimator.voltage_soc()) is not None:
            self._needs_voltage_soc = False
            self._offset.compare(*voltage_soc)
            self.sensor = self._offset.estimate()
        if self._t_s - self._judged_s >= JUDGE_S:
            self._judge()
        if not self._predicts:
            self.assessment = self._learned_so_far()
            return True
        branches = estimator.state_mean[1 : 1 + self.cell.n_rc]
        if branches.shape[0] != self.cell.n_rc:
            branches = np.zeros((self.cell.n_rc, len(estimates.soc)))
        states = OperatingPoint(estimates.soc, branches, temperatures_degc)
        load_a = current_a if self._load_a is None else self._load_a
        learned = self.learned
        of_cells = CellKnowledge(
            estimates.soc_sigma,
            learned.resistance_factor,
            learned.resistance_sigma,
            learned.capacity_ah,
            learned.capacity_sigma_ah / learned.capacity_ah,
            self._heat.cooling_w,
        )
        self._forecast.begin(states, of_cells)
        of_cells = replace(of_cells, voltage_scale=self._forecast.scale)
        mean_a, loss_a = self._driven_current_a()

        def energy_to(soc: float, pace: float) -> EnergyLeft:
            return energy_left(
                self.cell,
                estimates.soc,
                estimates.soc_sigma,
                temperatures_degc,
                pace * mean_a,
                soc,
                capacity_ah=learned.capacity_ah,
                resistance_factor=learned.resistance_factor,
                capacity_sigma_ah=learned.capacity_sigma_ah,
                resistance_sigma=learned.resistance_sigma,
                loss_current_a=pace * loss_a,
                v_min_v=limits.v_min_v,
                branch_a=branches,
            )

        is_whole = not self._unknown_cells  # else the sums over the cells would be too low
        energy = energy_to(limits.soc_min, 1.0) if is_whole else None
        steady_a = load_a if abs(load_a) >= RESTING_A else 0.0
        model = PowerModel(self.cell, limits, of_cells)
        power, (to_trip, to_trip_full) = model.predict(states, (steady_a, limits.discharge_max_a))
        assessment = replace(
            self._learned_so_far(),
            power=power if is_whole else None,
            to_trip=to_trip,
            to_trip_full=to_trip_full,
            energy=energy,
            laps=None if energy is None else self._laps_left(energy),
            target=self._target.judge(self._laps, lambda reserve, pace: energy_to(limits.soc_min + reserve, pace))
            if is_whole
            else None,
        )
        self.assessment = replace(
            assessment, prediction=self._prediction(assessment, steady_a, mean_a, temperatures_degc)
        )
        return True

    def _learned_so_far(self) -> Assessment:
        return Assessment(
            joints=self._joints,
            loose=self._watch.has("joint-resistance-high"),
            health=self._health,
            capacity_ah=self._capacity_ah,
            learned=self.learned,
        )

    def _driven_current_a(self) -> tuple[float, float]:
        """Mean current of the last minutes of driving, and mean of its square over that [A]; 0 while it charged."""
        time, charge, square = self._driven
        return (charge / time, square / charge) if charge > 0.0 else (0.0, 0.0)

    def _laps_left(self, energy: EnergyLeft) -> LapsLeft | None:
        laps = self._laps.laps
        left = None if laps is None else laps_left(energy, laps.energies_wh)
        return left and replace(left, period_s=None if laps is None else laps.period_s)

    def _judge(self) -> None:
        self._judged_s = self._t_s
        self._watch.judge()
        self._joints = self._watch.joints
        self.findings = self._found()
        tracker = self._capacities.tracker
        self.learned = learned = self._learned()
        self._offset.use_capacity(float(learned.capacity_ah.mean()))
        self._capacity_ah = tracker.capacity_ah()
        capacity_ah = np.where(learned.has_capacity, learned.capacity_ah, np.nan)
        resistance_factor = np.where(learned.has_resistance, learned.resistance_factor, np.nan)
        self._health = state_of_health(capacity_ah, learned.capacity_sigma_ah, tracker.nominal_ah, resistance_factor)
        self._laps.judge()

    def _found(self) -> tuple[Finding, ...]:
        return findings_in_words(self._watch.findings, self._sensors)

    def _learned(self) -> Learned:
        tracker = self._capacities.tracker
        return learned(tracker.nominal_ah, tracker.capacity_ah(), tracker.sigma_ah(), *self._scale.judge())

    def _prediction(
        self, assessment: Assessment, load_a: float, driven_a: float, temperatures_degc: FloatArray
    ) -> Prediction:
        nearest = min(assessment.to_trip, key=lambda trip: trip.seconds, default=None)
        energy, learned = assessment.energy, assessment.learned
        measured_a = self.cell.fit_current_max_a or None
        unknown = cells_unknown(self._unknown_cells)
        temperatures = beyond_temperatures(self.cell, temperatures_degc)
        is_beyond = None if energy is None else energy.beyond_measured or temperatures is not None
        return Prediction(
            power=assessment.power,
            to_trip=assessment.to_trip,
            to_trip_full=assessment.to_trip_full,
            nearest=None if nearest is None or not isfinite(nearest.seconds) else nearest,
            energy_left_wh=None if energy is None else energy.energy_wh,
            energy_left_sigma_wh=None if energy is None else energy.sigma_wh,
            energy_left_low_wh=None if energy is None else energy.low_wh,
            energy_left_high_wh=None if energy is None else energy.high_wh,
            energy_left_cell=None if energy is None else energy.cell,
            energy_left_beyond_measured=is_beyond,
            counted_with=None if learned is None else _counted_with(learned),
            laps=assessment.laps,
            target=assessment.target,
            coverage=COVERAGE,
            age_s=None,
            load_a=load_a,
            measured_current_max_a=measured_a,
            power_condition=unknown or power_held(assessment.power, temperatures),
            to_trip_condition=at_load(load_a, assessment.to_trip, temperatures),
            energy_condition=unknown or until_empty(driven_a, is_beyond, temperatures),
            laps_condition=unknown or laps_known(self._laps, assessment.laps),
        )


def _watched_before(learned_before: LearnedCells | None) -> CellWatchMemory | None:
    if learned_before is None:
        return None
    return learned_before.watch or CellWatchMemory(learned_before.joint_baseline_ohm)


def _counted_with(learned: Learned) -> CountedWith:
    """How many cells are counted with what was learned of them, and how far those lie from the cell file on average."""
    capacity, resistance = learned.has_capacity, learned.has_resistance
    share = learned.capacity_ah / learned.nominal_ah
    return CountedWith(
        capacity_cells=int(capacity.sum()),
        capacity_factor=float(share[capacity].mean()) if capacity.any() else None,
        resistance_cells=int(resistance.sum()),
        resistance_factor=float(learned.resistance_factor[resistance].mean()) if resistance.any() else None,
    )
