"""Cells carried forward at a constant current, with what is not known of them, by the closed form of the cell model.

    v(t)   = OCV(z(t)) - M sign(i) - (1 + b x(t)) drop(z(t), i_k(t), i),   z(t) = z - i t / Q
    i_k(t) = a_k i_k + (1 - a_k) i,   a_k = exp(-t / tau_k)
    x(t)   = max(|i| / i_m(t) - 1, 0)
    T(t)   = T + ((OCV(z) - v(t)) i - cooling) t / C_th

No time steps are taken. Sigmas are carried along to first order; a cell's own errors are taken to be independent.
i_m depletes a cell in the time t as far as any current that the cell file was measured with. Beyond it a cell drops
more than the model of it: b x is expected on top, with a sigma of as much, so that the upper end of a band is the model
as it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from app.estimation.arrays import BoolArray, FloatArray
from app.estimation.cell_model.circuit import SECONDS_PER_HOUR, CellModel
from app.estimation.cell_model.evidence import HELD_S, PULSE_S, Evidence, sand_current_a
from app.estimation.cell_model.surface import GAS_CONSTANT, KELVIN
from app.estimation.errors import ShapeError
from app.estimation.filters.tuning import Tuning

VOLTAGE_SIGMA_V: Final = 0.01  # circuit against cell, where the cell file has no error
RESISTANCE_SIGMA_FRAC: Final = 0.08  # any resistance: slow and fast parts do not scale alike
CHARGE_SIGMA_FRAC: Final = 0.2  # on charge: few tests charge hard, hardly any a cell that is nearly full
BAND_SIGMAS: Final = 1.645  # 5 to 95 %
MEASURED_TOLERANCE: Final = 0.02  # by which a current counts as one that was measured
BEYOND_DROP: Final = 0.6  # b
BEYOND_MODEL_FRAC: Final = 0.2  # by which the model's drop itself may be off, of the current's part that none measured
TINY_A: Final = 1e-9
SLOWER_J_MOL: Final = 40e3  # by which diffusion slows in the cold, where the cell file does not say
TEMPERATURE_SIGMA_DEGC: Final = 1.0  # the sensor, and that it is not in the cell
HEATING_SIGMA_FRAC: Final = 0.5  # share of the warming without cooling


@dataclass(frozen=True)
class Limits:
    """Limits of every cell; currents are magnitudes of the accumulator's current.

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
    """Present state of the cells: arrays over cells, `branch_a` is (n_rc, n_cells) [A]. NaN in soc = cell left out."""

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
    """Corrections of each cell to the cell file: (n_cells,) or scalars.

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
    """Result of a constant current: arrays over (..., n_cells), each with its standard deviation."""

    voltage_v: FloatArray
    voltage_sigma_v: FloatArray
    soc: FloatArray
    soc_sigma: FloatArray
    temperature_degc: FloatArray
    temperature_sigma_degc: FloatArray


def carry_forward(
    cell: CellModel,
    states: OperatingPoint,
    knowledge: CellKnowledge,
    current_a: FloatArray,
    time_s: FloatArray,
    heat_capacity_j_k: float,
) -> Ahead:
    """Return voltage, SOC and temperature after a constant current.

    Args:
        cell: model of the cells.
        states: the cells now.
        knowledge: what is known of them.
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
    capacity_ah = np.asarray(cell.capacity_ah if knowledge.capacity_ah is None else knowledge.capacity_ah)
    moved = current * seconds / (SECONDS_PER_HOUR * capacity_ah)
    soc = states.soc - np.where(moved < 0.0, cell.coulombic_efficiency * moved, moved)
    temperature = np.where(np.isnan(states.temperature_degc), 25.0, states.temperature_degc)
    decay = np.exp(-seconds / cell.time_constants(soc, temperature))
    before_a = states.branch_a.reshape(cell.n_rc, *[1] * (soc.ndim - 1), n)
    branch_a = decay * before_a + (1.0 - decay) * current
    beyond = beyond_measured(cell, current, seconds, temperature)
    of_model = cell.drop_v(soc, branch_a, current, temperature, knowledge.resistance_factor)
    drop = (1.0 + beyond.expected) * of_model
    gap_v = cell.hysteresis_v * np.sign(current)
    soc_sigma = np.hypot(knowledge.soc_sigma, moved * knowledge.capacity_sigma_frac) + np.zeros_like(soc)
    loss_w = np.maximum(drop * current, 0.0)
    heating = np.maximum(loss_w - knowledge.cooling_w, 0.0) * seconds / heat_capacity_j_k
    return Ahead(
        cell.open_circuit_voltage(soc, temperature) - gap_v - drop,
        np.hypot(
            voltage_sigma_v(cell, knowledge, OperatingPoint(soc, branch_a, temperature), soc_sigma, current, of_model),
            beyond.sigma * np.abs(of_model),
        ),
        soc,
        soc_sigma,
        temperature + heating,
        np.hypot(TEMPERATURE_SIGMA_DEGC, HEATING_SIGMA_FRAC * loss_w * seconds / heat_capacity_j_k),
    )


def knows_currents(cell: CellModel) -> bool:
    """Return whether the cell file says which currents it was measured with."""
    return bool(np.isfinite(measured_current_a(cell, 0.0)))


def measured_current_a(cell: CellModel, time_s: ArrayLike, temperature_degc: ArrayLike = 25.0) -> FloatArray:
    """Return the largest current that the cell file was measured with for so long [A]; infinite where unknown."""
    return np.minimum(_depleting_current_a(cell, time_s, temperature_degc), cell.fit_current_max_a or np.inf)


def _depleting_current_a(cell: CellModel, time_s: ArrayLike, temperature_degc: ArrayLike) -> FloatArray:
    """Return the current that depletes as much in a time as was measured [A].

    Colder than anything that was measured diffusion is slower, and less current depletes as much. A file that only has
    the largest current of an instant is taken to have held it for a pulse, and a data sheet's lasting one for long.
    """
    held = () if cell.evidence is None else cell.evidence.held
    if not held and cell.fit_current_max_a:
        held = ((PULSE_S, cell.fit_current_max_a), (HELD_S[-1], cell.limits.discharge_max_a or 0.0))
    coldest_k = cell.measured_degc[0] + KELVIN
    inverse_k = 1.0 / np.minimum(np.asarray(temperature_degc, dtype=np.float64) + KELVIN, coldest_k)
    energy = max(SLOWER_J_MOL, 0.0 if cell.surface is None else cell.surface.diffusion_j_mol)
    slower = np.exp(energy / GAS_CONSTANT * (inverse_k - 1.0 / coldest_k))
    return np.asarray(sand_current_a(held, time_s) / slower)


class Beyond(NamedTuple):
    """Excess of a current over the measured ones, as shares of the model's drop."""

    expected: FloatArray  # that comes on top
    sigma: FloatArray


def beyond_measured(
    cell: CellModel, current_a: ArrayLike, time_s: ArrayLike, temperature_degc: ArrayLike = 25.0
) -> Beyond:
    """Return what a constant current drops more than a model that was never measured with it so long."""
    magnitude_a = np.maximum(np.abs(current_a), TINY_A)
    more = BEYOND_DROP * np.maximum(magnitude_a / _depleting_current_a(cell, time_s, temperature_degc) - 1.0, 0.0)
    unseen = np.maximum(1.0 - measured_current_a(cell, time_s, temperature_degc) / magnitude_a, 0.0)
    return Beyond(more, (more + BEYOND_MODEL_FRAC * unseen) / BAND_SIGMAS)


def is_beyond_measured(
    cell: CellModel, current_a: ArrayLike, time_s: ArrayLike, temperature_degc: ArrayLike = 25.0
) -> BoolArray:
    """Return whether a constant current was never measured for so long; False where the file does not say."""
    limit_a = (1.0 + MEASURED_TOLERANCE) * measured_current_a(cell, time_s, temperature_degc)
    return np.asarray(np.abs(current_a) > limit_a)


def is_beyond_temperatures(cell: CellModel, temperature_degc: FloatArray) -> bool:
    """Return whether a cell is so far from the temperatures of the cell file that its resistances are not known."""
    finite = temperature_degc[np.isfinite(temperature_degc)]
    return bool((cell.drop_error(finite) > Tuning().drop_error_max).any())


def voltage_sigma_v(
    cell: CellModel,
    knowledge: CellKnowledge,
    states: OperatingPoint,
    soc_sigma: FloatArray,
    current_a: FloatArray,
    drop_v: FloatArray,
) -> FloatArray:
    """Return what SOC, resistances, circuit and temperature make unsure of a voltage [V].

    Args:
        cell: model of the cell.
        knowledge: what is known of it.
        states: at that moment, (...) and branches (n_rc, ...).
        soc_sigma: standard deviation of the SOC then.
        current_a: at that moment [A].
        drop_v: below the open-circuit voltage [V].
    """
    degc = states.temperature_degc
    surface = cell.surface_soc(states.soc, states.branch_a, degc, knowledge.resistance_factor)
    by_soc = cell.ocv.slope(surface) * soc_sigma
    of_circuit = np.where(np.asarray(current_a) < 0.0, CHARGE_SIGMA_FRAC, RESISTANCE_SIGMA_FRAC)
    by_resistance = drop_v * np.sqrt(np.square(knowledge.resistance_sigma) + of_circuit**2 + cell.drop_error(degc) ** 2)
    left = cell.evidence or Evidence()
    by_circuit = left.error_v(cell.fit_voltage_rms_v or VOLTAGE_SIGMA_V, states.soc, current_a / cell.c_rate_a, degc)
    variance = by_soc**2 + by_resistance**2 + by_circuit**2 + cell.ocv_error_v(degc) ** 2
    return np.asarray(np.sqrt(variance) * knowledge.voltage_scale)
