"""What lies ahead: power, time to the limits, energy and laps left, loose joints, capacities. Time is an argument.

`step` takes every measurement and is cheap; `look` does the rest, at most once a second, after the snapshot has gone
out. It feeds app.estimation and knows no equation itself.
"""

from collections import deque
from dataclasses import asdict, dataclass, replace
from math import isfinite
from typing import Any

import numpy as np

from app.estimation.circuit import CellModel
from app.estimation.estimators import CellEstimator, Estimates
from app.estimation.health import SOC_MOVED_MIN, CapacityTracker, StateOfHealth, state_of_health
from app.estimation.joint_watch import JUDGE_S, JointWatch
from app.estimation.joints import JointReport
from app.estimation.power import CellStates, Limits, PowerModel, StatePower, TimeToTrip
from app.estimation.prediction import EnergyLeft, LapsLeft, energy_left, lap_energies_wh, lap_period_s, laps_left
from app.telemetry import BoolArray, FloatArray
from firmware_protocol.memory_map import CELLS_PER_PACK

LOOK_S = 1.0
TRACE_S = 600.0  # of power, for laps
TRACE_STEP_S = 0.5
LAPS_KEPT = 8
STOPPED_LAP_SHARE = 0.25  # of the median lap's energy: a driver change, not a lap
DRIVING_A = 2.0
REST_A = 1.0  # below, no current flows: what is left is the sensor's noise and offset
REST_S = 120.0  # then the RC pairs have settled to a few millivolts
REST_SOC_SIGMA = 0.015
COUNT_GAIN_SIGMA = 0.005  # of the charge counted
COUNT_OFFSET_A = 0.5  # of the current sensor


@dataclass(frozen=True)
class Outlook:
    """The latest judgement; None where there is not enough to judge."""

    power: StatePower | None = None
    to_trip: tuple[TimeToTrip, ...] = ()  # at the present current
    to_trip_full: tuple[TimeToTrip, ...] = ()  # at the full discharge current
    energy: EnergyLeft | None = None
    laps: LapsLeft | None = None
    lap_period_s: float | None = None
    joints: JointReport | None = None
    loose: BoolArray | None = None  # confirmed
    health: StateOfHealth | None = None
    capacity_ah: FloatArray | None = None
    prediction: dict[str, Any] | None = None  # the above that is not per cell, as the API shows it


@dataclass(frozen=True)
class CellPast:
    """What earlier sessions of the same cells taught."""

    capacity_state: FloatArray  # (6, n_cells), of CapacityTracker
    joint_baseline_ohm: FloatArray  # (n_cells,), of JointWatch


class CapacityBetweenRests:
    """Capacity of every cell from what was counted between two rests, whose SOC the voltage tells."""

    def __init__(self, cell: CellModel, tracker: CapacityTracker) -> None:
        self._cell = cell
        self.tracker = tracker
        self._rest_s = 0.0
        self._charge_ah = 0.0
        self._elapsed_s = 0.0
        self._anchor: FloatArray | None = None

    def step(self, dt_s: float, current_a: float, voltages_v: FloatArray) -> bool:
        """Count; True where a rest closed a stretch and the capacities are new."""
        self._charge_ah += current_a * dt_s / 3600.0
        self._elapsed_s += dt_s
        self._rest_s = self._rest_s + dt_s if abs(current_a) < REST_A else 0.0
        if self._rest_s < REST_S:
            return False
        self._rest_s = 0.0
        soc = self._cell.ocv.soc_at(voltages_v)
        if self._anchor is None:
            self._begin(soc)
            return False
        moved = self._anchor - soc
        if not (np.abs(moved) >= SOC_MOVED_MIN).any():
            return False  # go on counting from the older rest
        sigma_ah = abs(self._charge_ah) * COUNT_GAIN_SIGMA + COUNT_OFFSET_A * self._elapsed_s / 3600.0 + 1e-3
        self.tracker.observe(moved, REST_SOC_SIGMA * np.sqrt(2.0), self._charge_ah, sigma_ah)
        self._begin(soc)
        return True

    def _begin(self, soc: FloatArray) -> None:
        self._anchor = soc
        self._charge_ah = self._elapsed_s = 0.0


class Lookout:
    """Keeps what has to be remembered between two looks."""

    def __init__(self, cell: CellModel, n_cells: int, past: CellPast | None = None) -> None:
        self.cell = cell
        self.outlook = Outlook()
        self._joint_watch = JointWatch(n_cells, CELLS_PER_PACK, None if past is None else past.joint_baseline_ohm)
        self._capacities = CapacityBetweenRests(
            cell, CapacityTracker(cell.capacity_ah, n_cells, None if past is None else past.capacity_state)
        )
        self._new_resistance_ohm = float(cell.parameters(0.5, 25.0)[0])
        self._trace: deque[tuple[float, float]] = deque(maxlen=round(TRACE_S / TRACE_STEP_S))
        self._t_s = 0.0
        self._trace_s = self._looked_s = self._judged_s = -1e9
        self._square_a2 = 0.0  # mean square of the current while driving
        self._joints: JointReport | None = None
        self._health: StateOfHealth | None = None
        self._capacity_ah: FloatArray | None = None
        self._lap_period_s: float | None = None
        self._lap_energies_wh: FloatArray = np.empty(0)

    @property
    def past(self) -> CellPast:
        """What to keep for the next session of the same cells."""
        return CellPast(self._capacities.tracker.state, self._joint_watch.baseline_ohm)

    def step(self, dt_s: float, current_a: float, voltages_v: FloatArray, power_w: float) -> None:
        """Take one measurement."""
        self._t_s += dt_s
        self._joint_watch.step(dt_s, current_a, voltages_v)
        if abs(current_a) > DRIVING_A:
            self._square_a2 += min(1.0, dt_s / 60.0) * (current_a * current_a - self._square_a2)
        if self._t_s - self._trace_s >= TRACE_STEP_S:
            self._trace_s = self._t_s
            self._trace.append((self._t_s, power_w))
        self._capacities.step(dt_s, current_a, voltages_v)

    def look(
        self,
        estimator: CellEstimator,
        estimates: Estimates,
        temperatures_degc: FloatArray,
        current_a: float,
        limits: Limits,
    ) -> None:
        """Judge anew if a second has passed."""
        if self._t_s - self._looked_s < LOOK_S:
            return
        self._looked_s = self._t_s
        if not np.isfinite(estimates.soc).any():
            self.outlook = Outlook()
            return
        if self._t_s - self._judged_s >= JUDGE_S:
            self._judge()
        branches = estimator.state_mean[1 : 1 + self.cell.n_rc]
        if branches.shape[0] != self.cell.n_rc:
            branches = np.zeros((self.cell.n_rc, len(estimates.soc)))
        states = CellStates(estimates.soc, branches, temperatures_degc)
        model = PowerModel(self.cell, limits)
        rms_a = float(np.sqrt(self._square_a2))
        energy = energy_left(self.cell, estimates.soc, estimates.soc_sigma, temperatures_degc, rms_a, limits.soc_min)
        outlook = Outlook(
            power=model.state_of_power(states),
            to_trip=model.times_to_trip(states, current_a),
            to_trip_full=model.times_to_trip(states, limits.discharge_max_a),
            energy=energy,
            laps=laps_left(energy, self._lap_energies_wh),
            lap_period_s=self._lap_period_s,
            joints=self._joints,
            loose=self._joint_watch.loose,
            health=self._health,
            capacity_ah=self._capacity_ah,
        )
        self.outlook = replace(outlook, prediction=_prediction(outlook))

    def _judge(self) -> None:
        self._judged_s = self._t_s
        self._joints = self._joint_watch.judge()
        tracker = self._capacities.tracker
        self._capacity_ah = tracker.capacity_ah()
        self._health = state_of_health(
            self._capacity_ah,
            tracker.sigma_ah(),
            tracker.nominal_ah,
            self._joints.resistance_ohm,
            self._new_resistance_ohm,
        )
        self._find_laps()

    def _find_laps(self) -> None:
        if len(self._trace) < 2:
            return
        time_s, power_w = np.array(self._trace).T
        self._lap_period_s = lap_period_s(time_s, power_w)
        if self._lap_period_s is None:
            return
        n_laps = min(LAPS_KEPT, int((time_s[-1] - time_s[0]) / self._lap_period_s))
        marks = time_s[-1] - self._lap_period_s * np.arange(n_laps, -1, -1)
        laps = lap_energies_wh(time_s, power_w, marks)
        self._lap_energies_wh = laps[laps > STOPPED_LAP_SHARE * np.median(laps)]


def _prediction(outlook: Outlook) -> dict[str, Any]:
    """Infinite times become None: not within an hour."""

    def trips(found: tuple[TimeToTrip, ...]) -> list[dict[str, Any]]:
        return [asdict(trip) | {"seconds": trip.seconds if isfinite(trip.seconds) else None} for trip in found]

    nearest = min(outlook.to_trip, key=lambda trip: trip.seconds, default=None)
    power, energy, laps = outlook.power, outlook.energy, outlook.laps
    return {
        "power": power
        and {
            "discharge": [asdict(limit) for limit in power.discharge],
            "charge": [asdict(limit) for limit in power.charge],
        },
        "to_trip": trips(outlook.to_trip),
        "to_trip_full": trips(outlook.to_trip_full),
        "nearest": None if nearest is None or not isfinite(nearest.seconds) else asdict(nearest),
        "energy_left_wh": energy and energy.energy_wh,
        "energy_left_sigma_wh": energy and energy.sigma_wh,
        "energy_left_cell": energy and energy.cell,
        "laps": laps and asdict(laps) | {"period_s": outlook.lap_period_s},
    }
