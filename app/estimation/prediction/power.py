"""State of power: what the accumulator can give and take for some seconds ahead, and how long until a limit trips.

The largest currents and the times to the limits are bisected together. A band comes from the same search with the
margins of the cell that limits shifted by their sigma: the pessimist's and the optimist's answer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from app.estimation.arrays import BoolArray, FloatArray, IntArray
from app.estimation.cell_model.circuit import CellModel
from app.estimation.errors import ModelError
from app.estimation.prediction.constant_current import (
    BAND_SIGMAS,
    Ahead,
    CellKnowledge,
    Limits,
    OperatingPoint,
    carry_forward,
    is_beyond_measured,
    is_beyond_temperatures,
    measured_current_a,
)

Reason = Literal["voltage", "soc", "temperature", "current", "relays"]
Limit = Literal["v_min", "v_max", "soc_min", "soc_max", "temperature_max"]

REASONS: Final[tuple[Reason, ...]] = ("voltage", "soc", "temperature")  # in the order of the margins
DISCHARGE_LIMITS: Final[tuple[Limit, ...]] = ("v_min", "soc_min", "temperature_max")
CHARGE_LIMITS: Final[tuple[Limit, ...]] = ("v_max", "soc_max", "temperature_max")

HORIZONS_S: Final = (1.0, 10.0, 30.0)
GRID: Final = 8  # parts of the current limit or of the hour that are looked at first
ROUNDS: Final = 10  # bisections after it: to 1/8192
TIME_LIMIT_S: Final = 3600.0  # later trips are not predicted
COVERAGE: Final = 0.9  # every band: the truth is expected within it nine times in ten
QUANTILES: Final = np.array((BAND_SIGMAS, 0.0, -BAND_SIGMAS))  # margins below these are passed: low, median, high
TINY: Final = 1e-9  # sigma of what is known exactly


@dataclass(frozen=True)
class PowerLimit:
    """Power that can be held for one horizon in one direction.

    Attributes:
        horizon_s: how long [s].
        power_w: power that is held throughout, of all cells together; positive in both directions [W].
        low_w, high_w: its band [W].
        current_a: magnitude of the current [A].
        cell: index of the cell that limits, None where the accumulator's current limit does.
        reason: which limit it meets; `relays`: they are open, nothing can flow.
        measured_a: largest current that the cell file was measured with for so long; None = the file does not say [A].
        beyond_measured: current or temperature lie beyond those of the cell file; None = the file does not say.
    """

    horizon_s: float
    power_w: float
    low_w: float
    high_w: float
    current_a: float
    cell: int | None
    reason: Reason
    measured_a: float | None
    beyond_measured: bool | None


@dataclass(frozen=True)
class StatePower:
    """Discharge and charge power for every horizon, shortest first."""

    discharge: tuple[PowerLimit, ...]
    charge: tuple[PowerLimit, ...]


@dataclass(frozen=True)
class TimeToTrip:
    """Seconds until a limit is met at a constant current, with their band; inf = not within an hour.

    `cell` is who meets it first, None where none does. `beyond_measured` is as in `PowerLimit`,
    at that time; None also where the charge limits.
    """

    limit: Limit
    seconds: float
    low_s: float
    high_s: float
    cell: int | None
    beyond_measured: bool | None


@dataclass(frozen=True)
class _Questions:
    """How far an argument x in 0..1 can go before a cell passes a limit; arrays over the questions.

    Attributes:
        current_a, seconds: at x = 1; positive on discharge [A], [s].
        in_current: True where x scales the current, False where it scales the time.
        counts: (3, n) which of the margins of voltage, SOC and temperature are asked for.
    """

    current_a: FloatArray
    seconds: FloatArray
    in_current: BoolArray
    counts: BoolArray

    def at(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return currents [A] and times [s] for x, both (..., n)."""
        current_a = np.where(self.in_current, x, 1.0) * self.current_a
        return current_a, np.where(self.in_current, 1.0, x) * self.seconds


def _questions(limits: Limits, currents_a: tuple[float, ...], horizons_s: tuple[float, ...]) -> _Questions:
    """Discharge and charge power for the horizons, then the times to three limits at each current."""
    n_power, n_trips = 2 * len(horizons_s), 3 * len(currents_a)
    full_a = np.repeat((limits.discharge_max_a, -limits.charge_max_a), len(horizons_s))
    masks = np.tile(np.eye(3, dtype=np.bool_), len(currents_a))
    return _Questions(
        current_a=np.concatenate((full_a, np.repeat(currents_a, 3))),
        seconds=np.concatenate((horizons_s, horizons_s, np.full(n_trips, TIME_LIMIT_S))),
        in_current=np.arange(n_power + n_trips) < n_power,
        counts=np.hstack((np.ones((3, n_power), dtype=np.bool_), masks)),
    )


class PowerModel:
    """Cells of one model with limits, and what is known of each of them."""

    def __init__(self, cell: CellModel, limits: Limits, knowledge: CellKnowledge | None = None) -> None:
        self.cell = cell
        self.limits = limits
        self.knowledge = knowledge or CellKnowledge()

    def ahead(self, states: OperatingPoint, current_a: FloatArray, time_s: FloatArray) -> Ahead:
        """Return what comes of a constant current, see `carry_forward`."""
        return carry_forward(self.cell, states, self.knowledge, current_a, time_s, self.limits.heat_capacity_j_k)

    def margins(self, states: OperatingPoint, current_a: FloatArray, time_s: FloatArray) -> FloatArray:
        """Return (3, ..., n_cells) distance to the limits of voltage, SOC and temperature in sigmas; below 0 = passed.

        For arguments see `carry_forward`.
        """
        limits = self.limits
        to, is_charge = self.ahead(states, current_a, time_s), current_a < 0.0
        voltage = np.where(is_charge, limits.v_max_v - to.voltage_v, to.voltage_v - limits.v_min_v)
        soc = np.where(is_charge, limits.soc_max - to.soc, to.soc - limits.soc_min)
        sigmas = np.stack((to.voltage_sigma_v, to.soc_sigma, to.temperature_sigma_degc))
        return np.stack((voltage, soc, limits.temperature_max_degc - to.temperature_degc)) / np.maximum(sigmas, TINY)

    def predict(
        self, states: OperatingPoint, currents_a: tuple[float, ...], horizons_s: tuple[float, ...] = HORIZONS_S
    ) -> tuple[StatePower, tuple[tuple[TimeToTrip, ...], ...]]:
        """Return the state of power, and the times to trip at each current.

        Raises:
            ModelError: no cell has an SOC.
            ShapeError: the states do not fit the model.
        """
        cells = np.flatnonzero(np.isfinite(states.soc))
        if cells.size == 0:
            raise ModelError("soc", "no cell has one: nothing can be predicted")
        model, part = self._of(cells), states.of(cells)
        questions = _questions(self.limits, currents_a, horizons_s)
        low, high = model._search(part, questions)
        n = len(horizons_s)
        power = model._power_limits(part, cells, questions, low, high)[: 2 * n]
        times = model._times_to_trip(part, cells, questions, low, high)[2 * n :]
        return (
            StatePower(power[:n], power[n:]),
            tuple(times[k : k + 3] for k in range(0, len(times), 3)),
        )

    def _of(self, cells: IntArray) -> PowerModel:
        return PowerModel(self.cell, self.limits, self.knowledge.of(cells))

    def _asked(self, states: OperatingPoint, questions: _Questions, x: FloatArray) -> FloatArray:
        """Return (3, ..., n, n_cells) margins at x (..., n), inf where they are not asked for."""
        current_a, time_s = questions.at(x)
        margins = self.margins(states, current_a[..., None], time_s[..., None])
        counts = questions.counts.reshape(3, *(1,) * (x.ndim - 1), -1, 1)
        return np.asarray(np.where(counts, margins, np.inf))

    def _search(self, states: OperatingPoint, questions: _Questions) -> tuple[FloatArray, FloatArray]:
        """Return x (3, n) just within and just beyond the limit of the first cell, for the three quantiles.

        Margins fall with x, so a cell within its limits at the upper end cannot be the first to pass: after a coarse
        grid hardly any is left.
        """
        grid = np.linspace(0.0, 1.0, GRID + 1)
        coarse = self._asked(states, questions, np.repeat(grid[1:, None], questions.seconds.size, axis=1)).min(axis=0)
        passes = coarse < QUANTILES[:, None, None, None]  # (3, GRID, n, n_cells)
        any_cell = passes.any(axis=3)
        never, first = ~any_cell.any(axis=1), any_cell.argmax(axis=1)
        low, high = grid[first], grid[first + 1]
        at_first = np.take_along_axis(passes, first[:, None, :, None], axis=1)
        left = np.flatnonzero(at_first.any(axis=(0, 1, 2)))
        model, part = self._of(left), states.of(left)
        for _ in range(ROUNDS if left.size else 0):
            middle = 0.5 * (low + high)
            margins = model._asked(part, questions, middle).min(axis=0)
            passed = (margins < QUANTILES[:, None, None]).any(axis=2)
            low, high = np.where(passed, low, middle), np.where(passed, middle, high)
        return np.where(never, 1.0, low), np.where(never, 1.0, high)

    def _power_limits(
        self, states: OperatingPoint, cells: IntArray, questions: _Questions, low: FloatArray, high: FloatArray
    ) -> tuple[PowerLimit, ...]:
        current_a, time_s = questions.at(low)
        time_s = np.where(current_a < 0.0, 0.0, time_s)  # the power is least at the end, on charge at the beginning
        to = self.ahead(states, current_a[..., None], time_s[..., None])
        off_v = QUANTILES[:, None] * np.where(current_a < 0.0, -1.0, 1.0) * to.voltage_sigma_v.sum(axis=-1)
        watts = np.maximum(np.abs(current_a) * (to.voltage_v.sum(axis=-1) - off_v), 0.0)
        watts.sort(axis=0)
        margins = self._asked(states, questions, high[1])  # (3, n, n_cells)
        least = margins.min(axis=0).argmin(axis=1)
        results = []
        for k, horizon_s in enumerate(questions.seconds):
            held_a = abs(float(current_a[1, k]))
            is_cell = bool(low[1, k] < 1.0)
            reason: Reason = REASONS[int(margins[:, k, least[k]].argmin())] if is_cell else "current"
            results.append(
                PowerLimit(
                    horizon_s=float(horizon_s),
                    power_w=float(watts[1, k]),
                    low_w=float(watts[0, k]),
                    high_w=float(watts[2, k]),
                    current_a=held_a,
                    cell=int(cells[least[k]]) if is_cell else None,
                    reason=reason,
                    measured_a=self._measured_a(float(horizon_s)),
                    beyond_measured=self._is_beyond(states, held_a, float(horizon_s)),
                )
            )
        return tuple(results)

    def _times_to_trip(
        self, states: OperatingPoint, cells: IntArray, questions: _Questions, low: FloatArray, high: FloatArray
    ) -> tuple[TimeToTrip, ...]:
        seconds = np.where(low < 1.0, low * TIME_LIMIT_S, math.inf)
        first = cells[self._asked(states, questions, high[1]).min(axis=0).argmin(axis=1)]
        results = []
        for k, current_a in enumerate(questions.current_a):
            names = CHARGE_LIMITS if current_a < 0.0 else DISCHARGE_LIMITS
            early, usual, late = (float(s) for s in seconds[:, k])
            name = names[int(questions.counts[:, k].argmax())]
            beyond = None  # a count of charge knows no drop
            if not name.startswith("soc"):
                beyond = self._is_beyond(states, float(current_a), min(usual, TIME_LIMIT_S))
            results.append(TimeToTrip(name, usual, early, late, None if math.isinf(usual) else int(first[k]), beyond))
        return tuple(results)

    def _measured_a(self, time_s: float) -> float | None:
        measured_a = float(measured_current_a(self.cell, time_s))
        return measured_a if math.isfinite(measured_a) else None

    def _is_beyond(self, states: OperatingPoint, current_a: float, time_s: float) -> bool | None:
        if is_beyond_temperatures(self.cell, states.temperature_degc):
            return True
        if self._measured_a(time_s) is None:
            return None
        return bool(is_beyond_measured(self.cell, current_a, time_s))
