"""From what the car delivers to what a filter may compute with: shapes checked, gaps filled where that is honest.

A missing voltage stays NaN (the cell is predicted only); a missing temperature or current is the last one.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from app.estimation.arrays import FloatArray, IntArray
from app.estimation.errors import EstimatorError, ShapeError
from app.estimation.filters.states import CellStates
from app.estimation.filters.tables import N_SOC, PackedCell
from app.estimation.filters.tuning import Tuning

TEMPERATURE_UNKNOWN_DEGC: Final = 25.0
TEMPERATURE_MAX_DEGC: Final = 200.0  # beyond it, either way, the sensor is broken
CURRENT_MAX_C: Final = 60.0  # a larger reading is a broken sensor, not a current
VOLTAGE_MIN_V: Final = 0.5  # a cell that reads 0 is not connected
VOLTAGE_MAX_V: Final = 6.0  # likewise: 6.5535 V is what the monitor says when it has not measured


class Climate(NamedTuple):
    """Where the temperatures of the cells lie in the tables.

    Attributes:
        row: (n,) table row.
        row_weight: (n,) weight of the next row.
        offset3: (3 n,) place of that row in a flat table, for the three sigma points.
        noise_scale: (n,) growth of the model error's variance outside the tables.
        is_inside: whether that is 1 for all cells.
    """

    row: IntArray
    row_weight: FloatArray
    offset3: FloatArray
    noise_scale: FloatArray
    is_inside: bool


class StepInput(NamedTuple):
    """What one step needs besides the state.

    Attributes:
        dt_s: step [s].
        current_a: held current [A].
        noise_v2: variance of the voltage's model error, without correlation [V^2].
        correlation: growth of it for the gain.
        voltage_v: (n,) [V], NaN = missing.
        climate: places of the temperatures; the same object as long as they are the same.
    """

    dt_s: float
    current_a: float
    noise_v2: float
    correlation: float
    voltage_v: FloatArray
    climate: Climate


def cell_array(name: str, values: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    """Return values as floats of a shape.

    Raises:
        ShapeError: they have another shape.
    """
    array = np.asarray(values, dtype=np.float64)
    if array.shape != shape:
        raise ShapeError(name, shape, array.shape)
    return array


class InputGuard:
    """Checks samples for the cells of one state and remembers the last current and the last temperatures."""

    def __init__(self, cell: PackedCell, state: CellStates, tuning: Tuning) -> None:
        self._cell = cell
        self._state = state
        self._tuning = tuning
        self._current_max_a = CURRENT_MAX_C * cell.model.capacity_ah
        self._drop_per_a_v = cell.model.drop_per_c_v / cell.model.c_rate_a
        self._current_a = 0.0
        self._shape = (state.n_cells,)
        self._temperature_raw = b""
        state.temperature_degc[:] = TEMPERATURE_UNKNOWN_DEGC
        self._climate = self._settle_temperature()

    def common(self, dt_s: float, current_a: float) -> float:
        """Return the current in force [A]: this one, or the last if this is missing or impossible.

        Raises:
            EstimatorError: dt_s is negative or not finite.
        """
        if not 0.0 <= dt_s < math.inf:
            raise EstimatorError(f"a step of {dt_s} s is no step")
        if abs(current_a) <= self._current_max_a:
            self._current_a = float(current_a)
        return self._current_a

    def check(self, dt_s: float, current_a: float, voltages_v: ArrayLike, temperatures_degc: ArrayLike) -> StepInput:
        """Return one sample as a filter wants it.

        Raises:
            ShapeError: an array is not (n_cells,).
            EstimatorError: dt_s is negative or not finite.
        """
        current = self.common(dt_s, current_a)
        voltage = cell_array("voltages_v", voltages_v, self._shape)
        temperature = cell_array("temperatures_degc", temperatures_degc, self._shape)
        # argmin and argmax find a NaN first
        if not (voltage.item(voltage.argmin()) > VOLTAGE_MIN_V and voltage.item(voltage.argmax()) < VOLTAGE_MAX_V):
            voltage = np.where((voltage > VOLTAGE_MIN_V) & (voltage < VOLTAGE_MAX_V), voltage, np.nan)
        raw = temperature.tobytes()
        if raw != self._temperature_raw:
            self._temperature_raw = raw
            known = np.abs(temperature) < TEMPERATURE_MAX_DEGC
            np.copyto(self._state.temperature_degc, temperature, where=known)
            self._climate = self._settle_temperature()
        tuning = self._tuning
        return StepInput(
            float(dt_s),
            current,
            tuning.voltage_variance(current * self._drop_per_a_v),
            tuning.correlation_factor(dt_s),
            voltage,
            self._climate,
        )

    def _settle_temperature(self) -> Climate:
        grid = self._cell.temperature_grid_degc
        t = self._state.temperature_degc
        row, weight = self._cell.place(t)
        outside_k = np.maximum(grid[0] - t, 0.0) + np.maximum(t - grid[-1], 0.0)
        cold = 1.0 + self._tuning.cold_factor * outside_k / 10.0
        return Climate(row, weight, np.tile(float(N_SOC) * row, 3), cold * cold, bool((cold == 1.0).all()))
