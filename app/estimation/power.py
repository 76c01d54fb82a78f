"""State of power: what the accumulator can give and take for some seconds ahead, and how long until a limit trips.

Every cell is carried forward at a constant current by the closed form of the circuit, so no time steps are taken:

    v(t) = OCV(z - i t / Q) - R0 i - e asinh(i / i_ref) - sum R_k (a_k i_k + (1 - a_k) i),   a_k = exp(-t / tau_k)
    T(t) = T + (OCV(z) - v(t)) i t / C_th                    without cooling, so a little too warm

The largest current and the time to a limit are found by bisection over the cells that could be the first to meet it;
call it once a second.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from app.estimation.circuit import SECONDS_PER_HOUR, CellModel
from app.estimation.errors import ModelError, ShapeError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]
Reason = Literal["voltage", "soc", "temperature", "current"]
Limit = Literal["v_min", "v_max", "soc_min", "soc_max", "temperature_max"]

REASONS: Final[tuple[Reason, ...]] = ("voltage", "soc", "temperature")  # in the order of the margins
DISCHARGE_LIMITS: Final[tuple[Limit, ...]] = ("v_min", "soc_min", "temperature_max")
CHARGE_LIMITS: Final[tuple[Limit, ...]] = ("v_max", "soc_max", "temperature_max")

HORIZONS_S: Final = (1.0, 10.0, 30.0)
HALVINGS: Final = 13  # 1/8192 of the current limit or of the hour
TIME_LIMIT_S: Final = 3600.0  # later trips are not foretold


@dataclass(frozen=True)
class Limits:
    """What no cell may pass; currents are magnitudes of the accumulator's current.

    Attributes:
        v_min_v, v_max_v: terminal voltage [V].
        discharge_max_a, charge_max_a: current [A].
        soc_min, soc_max: state of charge.
        temperature_max_degc: cell temperature [degC].
        heat_capacity_j_k: of one cell with what is glued to it [J/K]; inf leaves heating out.
    """

    v_min_v: float = 2.5
    v_max_v: float = 4.2
    discharge_max_a: float = 375.0
    charge_max_a: float = 50.0
    soc_min: float = 0.0
    soc_max: float = 1.0
    temperature_max_degc: float = 60.0
    heat_capacity_j_k: float = 430.0


@dataclass(frozen=True)
class CellStates:
    """Where the cells are now: arrays over cells, `branch_a` is (n_rc, n_cells) [A]. NaN in soc = cell left out."""

    soc: FloatArray
    branch_a: FloatArray
    temperature_degc: FloatArray

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return int(self.soc.size)


@dataclass(frozen=True)
class PowerLimit:
    """What can be held for one horizon in one direction.

    Attributes:
        horizon_s: how long [s].
        power_w: power at the end of the horizon, of all cells together; positive in both directions [W].
        current_a: magnitude of the current [A].
        cell: index of the cell that limits, None where the accumulator's current limit does.
        reason: which limit it meets.
    """

    horizon_s: float
    power_w: float
    current_a: float
    cell: int | None
    reason: Reason


@dataclass(frozen=True)
class StatePower:
    """Discharge and charge power for every horizon, shortest first."""

    discharge: tuple[PowerLimit, ...]
    charge: tuple[PowerLimit, ...]


@dataclass(frozen=True)
class TimeToTrip:
    """Seconds until a limit is met at a constant current; inf = not within an hour; `cell` is who meets it first."""

    limit: Limit
    seconds: float
    cell: int | None


@dataclass(frozen=True)
class _Bracket:
    """Arguments just within and just beyond the limit, and the cell that passes it; -1 = none does."""

    low: FloatArray
    high: FloatArray
    cell: IntArray


class PowerModel:
    """The circuit carried forward in closed form, for cells of one model with resistances and capacities of their own.

    `resistance_factor` (n_cells,) or scalar scales all resistances of a cell; `capacity_ah` (n_cells,) or scalar [Ah],
    None = the model's.
    """

    def __init__(
        self,
        cell: CellModel,
        limits: Limits,
        resistance_factor: ArrayLike = 1.0,
        capacity_ah: ArrayLike | None = None,
    ) -> None:
        self.cell = cell
        self.limits = limits
        self.resistance_factor = np.asarray(resistance_factor, dtype=np.float64)
        self.capacity_ah = np.asarray(cell.capacity_ah if capacity_ah is None else capacity_ah, dtype=np.float64)

    def ahead(self, states: CellStates, current_a: FloatArray, time_s: FloatArray) -> tuple[FloatArray, ...]:
        """Return voltage [V], SOC and temperature [degC] after a constant current.

        Args:
            states: the cells now.
            current_a: broadcasts against (..., n_cells), positive on discharge [A].
            time_s: broadcasts against it, >= 0 [s].

        Raises:
            ShapeError: the states do not fit the model.
        """
        cell, n = self.cell, states.n_cells
        if states.branch_a.shape != (cell.n_rc, n) or states.temperature_degc.shape != (n,):
            raise ShapeError("branch_a", (cell.n_rc, n), states.branch_a.shape)
        current, seconds = np.broadcast_arrays(current_a, time_s)
        moved = current * seconds / (SECONDS_PER_HOUR * self.capacity_ah)
        soc = states.soc - np.where(moved < 0.0, cell.coulombic_efficiency * moved, moved)
        temperature = np.where(np.isnan(states.temperature_degc), 25.0, states.temperature_degc)
        values = cell.parameters(np.clip(soc, 0.0, 1.0), temperature)
        drop = values[0] * current + values[1] * np.arcsinh(current / cell.overpotential_current_a)
        for k in range(cell.n_rc):
            decay = np.exp(-seconds / values[2 + cell.n_rc + k])
            drop = drop + values[2 + k] * (decay * states.branch_a[k] + (1.0 - decay) * current)
        drop = drop * self.resistance_factor
        heated = temperature + np.maximum(drop * current, 0.0) * seconds / self.limits.heat_capacity_j_k
        return cell.ocv.voltage(soc) - drop, soc, heated

    def _margins(self, states: CellStates, current: FloatArray, seconds: FloatArray) -> FloatArray:
        """Return (3, ..., n_cells) distance to the voltage, SOC and temperature limit; below 0 = passed."""
        limits = self.limits
        voltage, soc, temperature = self.ahead(states, current, seconds)
        is_charge = np.broadcast_to(current < 0.0, voltage.shape)
        return np.stack(
            (
                np.where(is_charge, limits.v_max_v - voltage, voltage - limits.v_min_v),
                np.where(is_charge, limits.soc_max - soc, soc - limits.soc_min),
                limits.temperature_max_degc - temperature,
            )
        )

    def state_of_power(self, states: CellStates, horizons_s: tuple[float, ...] = HORIZONS_S) -> StatePower:
        """Return what can be held over each horizon [s]; a cell with NaN SOC is left out.

        Raises:
            ModelError: no cell has an SOC.
            ShapeError: the states do not fit the model.
        """
        discharge = self._largest(states, horizons_s, 1.0, self.limits.discharge_max_a)
        return StatePower(discharge, self._largest(states, horizons_s, -1.0, self.limits.charge_max_a))

    def times_to_trip(self, states: CellStates, current_a: float) -> tuple[TimeToTrip, ...]:
        """Return when each limit is met at a constant current, in the order voltage, SOC, temperature.

        Args:
            states: the cells now; those with NaN SOC are left out.
            current_a: positive on discharge [A]; the present one, or the full one.

        Raises:
            ModelError: no cell has an SOC.
            ShapeError: the states do not fit the model.
        """
        names: tuple[Limit, ...] = CHARGE_LIMITS if current_a < 0.0 else DISCHARGE_LIMITS
        current = np.array(current_a)
        rows = np.arange(3)

        def margins(model: PowerModel, part: CellStates, seconds: FloatArray) -> FloatArray:
            return model._margins(part, current, seconds[:, None])[rows, rows]

        found = self._first_to_pass(states, margins, np.full(3, TIME_LIMIT_S))
        return tuple(
            TimeToTrip(name, float(low), int(cell)) if cell >= 0 else TimeToTrip(name, float("inf"), None)
            for name, low, cell in zip(names, found.low, found.cell, strict=True)
        )

    def _largest(
        self, states: CellStates, horizons_s: tuple[float, ...], sign: float, current_max_a: float
    ) -> tuple[PowerLimit, ...]:
        ahead_s = np.array(horizons_s)[:, None]

        def margins(model: PowerModel, part: CellStates, current_a: FloatArray) -> FloatArray:
            return np.asarray(model._margins(part, sign * current_a[:, None], ahead_s).min(axis=0))

        found = self._first_to_pass(states, margins, np.full(len(horizons_s), current_max_a))
        known = _known(states)
        model, part = self._subset(states, known)
        voltage, _, _ = model.ahead(part, sign * found.low[:, None], ahead_s)
        passed = model._margins(part, sign * found.high[:, None], ahead_s) < 0.0
        results = []
        for h, horizon in enumerate(horizons_s):
            current_a = float(found.low[h])
            power_w = float(voltage[h].sum() * current_a)
            if found.cell[h] < 0:
                results.append(PowerLimit(horizon, power_w, current_a, None, "current"))
            else:
                cell = int(found.cell[h])
                reason = REASONS[int(passed[:, h, int(np.searchsorted(known, cell))].argmax())]
                results.append(PowerLimit(horizon, power_w, current_a, cell, reason))
        return tuple(results)

    def _first_to_pass(
        self,
        states: CellStates,
        margins: Callable[[PowerModel, CellStates, FloatArray], FloatArray],
        largest: FloatArray,
    ) -> _Bracket:
        """Return where the margin of the first cell passes zero between 0 and `largest`, row by row.

        Margins fall with the argument, so a cell within its limits at the upper end cannot be the first to pass: it is
        left out of the halvings that follow, and after a few of them hardly any cell is left.
        """
        cells = _known(states)
        model, part = self._subset(states, cells)
        low, high = np.zeros_like(largest), largest.copy()
        margin = margins(model, part, high)
        never = np.asarray((margin >= 0.0).all(axis=1))
        low[never] = largest[never]
        for _ in range(HALVINGS):
            could_pass = np.flatnonzero((margin < 0.0).any(axis=0))
            if could_pass.size == 0:
                break
            if could_pass.size < cells.size:
                cells, margin = cells[could_pass], margin[:, could_pass]
                model, part = self._subset(states, cells)
            middle = 0.5 * (low + high)
            trial = margins(model, part, middle)
            passes = np.asarray((trial < 0.0).any(axis=1) & ~never)
            margin = np.where(passes[:, None], trial, margin)
            low, high = np.where(passes | never, low, middle), np.where(passes, middle, high)
        return _Bracket(low, high, np.where(never, -1, cells[margin.argmin(axis=1)]))

    def _subset(self, states: CellStates, known: IntArray) -> tuple[PowerModel, CellStates]:
        factor, capacity_ah = (
            own if own.ndim == 0 else own[known] for own in (self.resistance_factor, self.capacity_ah)
        )
        part = CellStates(states.soc[known], states.branch_a[:, known], states.temperature_degc[known])
        return PowerModel(self.cell, self.limits, factor, capacity_ah), part


def _known(states: CellStates) -> IntArray:
    known = np.flatnonzero(np.isfinite(states.soc))
    if known.size == 0:
        raise ModelError("soc", "no cell has one: nothing can be foretold")
    return known
