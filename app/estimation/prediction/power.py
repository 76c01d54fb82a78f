"""State of power: what the accumulator can give and take for some seconds ahead, and how long until a limit trips.

Every cell is carried forward at a constant current by the closed form of the circuit, so no time steps are taken:

    v(t) = OCV(z - i t / Q) - R0 i - e asinh(i / i_ref) - sum R_k (a_k i_k + (1 - a_k) i),   a_k = exp(-t / tau_k)
    T(t) = T + (OCV(z) - v(t)) i t / C_th                    without cooling, so a little too warm

The largest currents and the times to the limits are found together, in a few rounds, over the cells that could be
the first to meet one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from app.estimation.arrays import BoolArray, FloatArray, IntArray
from app.estimation.cell_model.circuit import SECONDS_PER_HOUR, CellModel
from app.estimation.errors import ModelError, ShapeError

Reason = Literal["voltage", "soc", "temperature", "current"]
Limit = Literal["v_min", "v_max", "soc_min", "soc_max", "temperature_max"]

REASONS: Final[tuple[Reason, ...]] = ("voltage", "soc", "temperature")  # in the order of the margins
DISCHARGE_LIMITS: Final[tuple[Limit, ...]] = ("v_min", "soc_min", "temperature_max")
CHARGE_LIMITS: Final[tuple[Limit, ...]] = ("v_max", "soc_max", "temperature_max")

HORIZONS_S: Final = (1.0, 10.0, 30.0)
RESOLUTION: Final = 1.0 / 8192.0  # of the current limit or of the hour
ROUND_VALUES: Final = 1500  # looked at in one round: fewer cost the calls, more the values
MAX_PARTS: Final = 16
TIME_LIMIT_S: Final = 3600.0  # later trips are not predicted


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
class OperatingPoint:
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
class _Search:
    """Questions of how far an argument x in 0..1 can go before a cell passes a limit; arrays over the questions.

    Attributes:
        current_a, seconds: at x = 1; positive on discharge [A], [s].
        in_current: (n,) True where x scales the current, False where it scales the time.
        counts: (3, n) which of the margins of voltage, SOC and temperature are asked for.
    """

    current_a: FloatArray
    seconds: FloatArray
    in_current: BoolArray
    counts: BoolArray

    def at(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return currents [A] and times [s], both (n, m, 1), for x (n, m)."""
        in_current = self.in_current[:, None]
        current = np.where(in_current, x, 1.0) * self.current_a[:, None]
        seconds = np.where(in_current, 1.0, x) * self.seconds[:, None]
        return current[..., None], seconds[..., None]


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

    def ahead(self, states: OperatingPoint, current_a: FloatArray, time_s: FloatArray) -> tuple[FloatArray, ...]:
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
        values = cell.parameters(soc, temperature)
        drop = values[0] * current + values[1] * np.arcsinh(current / cell.overpotential_current_a)
        for k in range(cell.n_rc):
            decay = np.exp(-seconds / values[2 + cell.n_rc + k])
            drop = drop + values[2 + k] * (decay * states.branch_a[k] + (1.0 - decay) * current)
        drop = drop * self.resistance_factor
        heated = temperature + np.maximum(drop * current, 0.0) * seconds / self.limits.heat_capacity_j_k
        return cell.ocv.voltage(soc) - drop, soc, heated

    def _margins(self, states: OperatingPoint, current: FloatArray, seconds: FloatArray) -> FloatArray:
        """Return (3, ..., n_cells) distance to the voltage, SOC and temperature limit; below 0 = passed."""
        limits = self.limits
        voltage, soc, temperature = self.ahead(states, current, seconds)
        is_charge = current < 0.0
        return np.stack(
            (
                np.where(is_charge, limits.v_max_v - voltage, voltage - limits.v_min_v),
                np.where(is_charge, limits.soc_max - soc, soc - limits.soc_min),
                limits.temperature_max_degc - temperature,
            )
        )

    def predict(
        self, states: OperatingPoint, currents_a: tuple[float, ...], horizons_s: tuple[float, ...] = HORIZONS_S
    ) -> tuple[StatePower, tuple[tuple[TimeToTrip, ...], ...]]:
        """Return the state of power, and the times to trip at each current: all in one search.

        Raises:
            ModelError: no cell has an SOC.
            ShapeError: the states do not fit the model.
        """
        n_power, n_trips = 2 * len(horizons_s), 3 * len(currents_a)
        directions = (self.limits.discharge_max_a, -self.limits.charge_max_a)
        search = _Search(
            current_a=np.concatenate((np.repeat(directions, len(horizons_s)), np.repeat(currents_a, 3))),
            seconds=np.concatenate((horizons_s, horizons_s, np.full(n_trips, TIME_LIMIT_S))),
            in_current=np.arange(n_power + n_trips) < n_power,
            counts=np.hstack(
                (np.ones((3, n_power), dtype=np.bool_), np.tile(np.eye(3, dtype=np.bool_), len(currents_a)))
            ),
        )
        found = self._first_to_pass(states, search)
        power = self._power_limits(states, search, found, n_power)
        trips = [
            TimeToTrip(name, float(low) * TIME_LIMIT_S, int(cell)) if cell >= 0 else TimeToTrip(name, math.inf, None)
            for name, low, cell in zip(
                (name for a in currents_a for name in (CHARGE_LIMITS if a < 0.0 else DISCHARGE_LIMITS)),
                found.low[n_power:],
                found.cell[n_power:],
                strict=True,
            )
        ]
        return (
            StatePower(power[: len(horizons_s)], power[len(horizons_s) :]),
            tuple(tuple(trips[k : k + 3]) for k in range(0, n_trips, 3)),
        )

    def _power_limits(
        self, states: OperatingPoint, search: _Search, found: _Bracket, n_power: int
    ) -> tuple[PowerLimit, ...]:
        known = _known(states)
        model, part = self._subset(states, known)
        current, seconds = search.at(found.low[:, None])
        voltage = model.ahead(part, current[:n_power, 0], seconds[:n_power, 0])[0]
        beyond, seconds = search.at(found.high[:, None])
        passed = model._margins(part, beyond[:n_power, 0], seconds[:n_power, 0]) < 0.0
        results = []
        for q in range(n_power):
            current_a = abs(float(current[q, 0, 0]))
            power_w = float(voltage[q].sum() * current_a)
            cell = int(found.cell[q])
            if cell < 0:
                results.append(PowerLimit(float(search.seconds[q]), power_w, current_a, None, "current"))
            else:
                which = int(passed[:, q, int(np.searchsorted(known, cell))].argmax())
                results.append(PowerLimit(float(search.seconds[q]), power_w, current_a, cell, REASONS[which]))
        return tuple(results)

    def _first_to_pass(self, states: OperatingPoint, search: _Search) -> _Bracket:
        """Return for each question where in 0..1 the margin of the first cell passes zero.

        Margins fall with the argument, so a cell within its limits at the upper end cannot be the first to pass: it is
        left out of the rounds that follow, and after the first of them hardly any cell is left.
        """
        cells = _known(states)
        model, part = self._subset(states, cells)

        def margins(x: FloatArray) -> FloatArray:
            every = model._margins(part, *search.at(x))
            return np.asarray(np.where(search.counts[:, :, None, None], every, np.inf).min(axis=0))

        n = search.current_a.size
        low, high, width = np.zeros(n), np.ones(n), 1.0
        margin = margins(high[:, None])[:, 0]
        never = np.asarray((margin >= 0.0).all(axis=1))
        low[never] = 1.0
        rows = np.arange(n)
        while width > RESOLUTION:
            could_pass = np.flatnonzero((margin < 0.0).any(axis=0))
            if could_pass.size == 0:
                break
            if could_pass.size < cells.size:
                cells, margin = cells[could_pass], margin[:, could_pass]
                model, part = self._subset(states, cells)
            parts = min(max(2, ROUND_VALUES // (n * cells.size)), MAX_PARTS)
            width /= parts
            x = low[:, None] + width * np.arange(1, parts)
            trial = margins(x)
            passes = np.asarray((trial < 0.0).any(axis=2))
            first = passes.argmax(axis=1)
            inside = passes[rows, first] & ~never  # else it passes in the last part, whose end is known
            margin = np.where(inside[:, None], trial[rows, first], margin)
            ends = np.column_stack((low, x, high))
            last = np.where(inside, first, parts - 1)
            low, high = np.where(never, low, ends[rows, last]), np.where(never, high, ends[rows, last + 1])
        return _Bracket(low, high, np.where(never, -1, cells[margin.argmin(axis=1)]))

    def _subset(self, states: OperatingPoint, known: IntArray) -> tuple[PowerModel, OperatingPoint]:
        factor, capacity_ah = (
            own if own.ndim == 0 else own[known] for own in (self.resistance_factor, self.capacity_ah)
        )
        part = OperatingPoint(states.soc[known], states.branch_a[:, known], states.temperature_degc[known])
        return PowerModel(self.cell, self.limits, factor, capacity_ah), part


def _known(states: OperatingPoint) -> IntArray:
    known = np.flatnonzero(np.isfinite(states.soc))
    if known.size == 0:
        raise ModelError("soc", "no cell has one: nothing can be predicted")
    return known
