"""Cells carried forward at a constant current, with what is not known of them, by the closed form of the cell model.

    v(t)   = OCV(z(t)) - drop(z(t), i_k(t), i),   z(t) = z - i t / Q
    i_k(t) = a_k i_k + (1 - a_k) i,   a_k = exp(-t / tau_k)
    T(t)   = T + ((OCV(z) - v(t)) i - cooling) t / C_th

No time steps are taken. Sigmas are carried along to first order; a cell's own errors are taken to be independent.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from app.estimation.arrays import FloatArray
from app.estimation.cell_model.circuit import SECONDS_PER_HOUR, CellModel
from app.estimation.errors import ShapeError

VOLTAGE_SIGMA_V: Final = 0.01  # of a circuit against a cell, where the cell file does not say it
RESISTANCE_SIGMA_FRAC: Final = 0.06  # of any resistance: what lasts and what is fast do not scale alike
BEYOND_SIGMA_FRAC: Final = 0.5  # of the drop that the current beyond the largest measured one adds
TEMPERATURE_SIGMA_DEGC: Final = 1.0  # the sensor, and that it is not in the cell
HEATING_SIGMA_FRAC: Final = 0.5  # of what the cell would warm without cooling


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

    def of(self, cells: ArrayLike) -> OperatingPoint:
        """Return the point of some of the cells, by index."""
        return OperatingPoint(self.soc[cells], self.branch_a[:, cells], self.temperature_degc[cells])  # type: ignore[index]


@dataclass(frozen=True)
class CellKnowledge:
    """What is known of each cell beside the cell file: (n_cells,) or scalars.

    Attributes:
        soc_sigma: standard deviation of the SOC.
        resistance_factor: all resistances of the cell over those of the cell file.
        resistance_sigma: its standard deviation.
        capacity_ah: capacity [Ah]; None = the cell file's.
        capacity_sigma_frac: its standard deviation over the capacity.
        cooling_w: heat that a cell loses to its surroundings [W].
        voltage_scale: of the sigma of a voltage, see `calibration`; scalar, or one a cell.
    """

    soc_sigma: ArrayLike = 0.0
    resistance_factor: ArrayLike = 1.0
    resistance_sigma: ArrayLike = 0.0
    capacity_ah: ArrayLike | None = None
    capacity_sigma_frac: ArrayLike = 0.0
    cooling_w: float = 0.0
    voltage_scale: ArrayLike = 1.0

    def of(self, cells: ArrayLike) -> CellKnowledge:
        """Return what is known of some of the cells, by index."""

        def part(value: ArrayLike) -> ArrayLike:
            array = np.asarray(value, dtype=np.float64)
            return array if array.ndim == 0 else array[cells]  # type: ignore[index]

        return CellKnowledge(
            part(self.soc_sigma),
            part(self.resistance_factor),
            part(self.resistance_sigma),
            None if self.capacity_ah is None else part(self.capacity_ah),
            part(self.capacity_sigma_frac),
            self.cooling_w,
            part(self.voltage_scale),
        )


class Ahead(NamedTuple):
    """What comes of a constant current: arrays over (..., n_cells), each with its standard deviation."""

    voltage_v: FloatArray
    voltage_sigma_v: FloatArray
    soc: FloatArray
    soc_sigma: FloatArray
    temperature_degc: FloatArray
    temperature_sigma_degc: FloatArray


def carry_forward(
    cell: CellModel,
    states: OperatingPoint,
    known: CellKnowledge,
    current_a: FloatArray,
    time_s: FloatArray,
    heat_capacity_j_k: float,
) -> Ahead:
    """Return voltage, SOC and temperature after a constant current.

    Args:
        cell: model of the cells.
        states: the cells now.
        known: what is known of them.
        current_a: broadcasts against (..., n_cells), positive on discharge [A].
        time_s: broadcasts against it, >= 0 [s].
        heat_capacity_j_k: of one cell [J/K].

    Raises:
        ShapeError: the states do not fit the model.
    """
    n = states.n_cells
    if states.branch_a.shape != (cell.n_rc, n) or states.temperature_degc.shape != (n,):
        raise ShapeError("branch_a", (cell.n_rc, n), states.branch_a.shape)
    current, seconds = np.broadcast_arrays(current_a, time_s)
    capacity_ah = np.asarray(cell.capacity_ah if known.capacity_ah is None else known.capacity_ah)
    moved = current * seconds / (SECONDS_PER_HOUR * capacity_ah)
    soc = states.soc - np.where(moved < 0.0, cell.coulombic_efficiency * moved, moved)
    temperature = np.where(np.isnan(states.temperature_degc), 25.0, states.temperature_degc)
    decay = np.exp(-seconds / cell.time_constants(soc, temperature))
    before_a = states.branch_a.reshape(cell.n_rc, *[1] * (soc.ndim - 1), n)
    branch_a = decay * before_a + (1.0 - decay) * current
    drop = cell.drop_v(soc, branch_a, current, temperature, known.resistance_factor)
    soc_sigma = np.hypot(known.soc_sigma, moved * known.capacity_sigma_frac) + np.zeros_like(soc)
    loss_w = np.maximum(drop * current, 0.0)
    heating = np.maximum(loss_w - known.cooling_w, 0.0) * seconds / heat_capacity_j_k
    return Ahead(
        cell.open_circuit_voltage(soc, temperature) - drop,
        voltage_sigma_v(cell, known, soc, soc_sigma, current, drop),
        soc,
        soc_sigma,
        temperature + heating,
        np.hypot(TEMPERATURE_SIGMA_DEGC, HEATING_SIGMA_FRAC * loss_w * seconds / heat_capacity_j_k),
    )


def voltage_sigma_v(
    cell: CellModel,
    known: CellKnowledge,
    soc: FloatArray,
    soc_sigma: FloatArray,
    current: FloatArray,
    drop: FloatArray,
) -> FloatArray:
    """Return what SOC, resistance and circuit, and currents beyond the measured ones, make unsure of a voltage [V].

    Args:
        cell: model of the cell.
        known: what is known of it.
        soc: state of charge at that moment.
        soc_sigma: its standard deviation.
        current: at that moment [A].
        drop: below the open-circuit voltage [V].
    """
    by_soc = cell.ocv.slope(soc) * soc_sigma
    by_resistance = drop * np.hypot(known.resistance_sigma, RESISTANCE_SIGMA_FRAC)
    variance = by_soc**2 + by_resistance**2 + (cell.fit_voltage_rms_v or VOLTAGE_SIGMA_V) ** 2
    if cell.fit_current_max_a:
        magnitude = np.abs(current)
        beyond = np.maximum(magnitude - cell.fit_current_max_a, 0.0) / np.maximum(magnitude, 1e-9)
        variance = variance + (BEYOND_SIGMA_FRAC * beyond * drop) ** 2
    return np.asarray(np.sqrt(variance) * known.voltage_scale)
