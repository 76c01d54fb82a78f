"""State of power, and the voltage some seconds ahead, at every row of one cell's recording."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from app.estimation.arrays import BoolArray, FloatArray
from app.estimation.cell_model.circuit import SECONDS_PER_HOUR, CellModel, charge_moved_coulomb
from app.estimation.filters.tuning import Tuning
from app.estimation.prediction.calibration import AHEAD_S, scale_along
from app.estimation.prediction.constant_current import (
    BAND_SIGMAS,
    CellKnowledge,
    Limits,
    OperatingPoint,
    is_beyond_measured,
    voltage_sigma_v,
)
from app.estimation.prediction.power import HORIZONS_S, QUANTILES, PowerModel

ROUNDS: Final = 13  # bisections: to 1/8192 of the largest current
CHUNK_ROWS: Final = 2048
UNKNOWN_S: Final = 10.0  # what flowed in a longer gap is not known; the RC pairs are taken to relax
CAPACITY_SIGMA_FRAC: Final = 0.02  # share of the capacity in a cell file
TEMPERATURE_MAX_DEGC: Final = 60.0  # where the cell file does not say
SURGE_C: Final = 50.0  # no cell gives more
Direction = Literal["discharge", "charge"]


@dataclass(frozen=True)
class PowerAlong:
    """Power that can be held for a horizon in one direction at every row: (n,), power and its band [W], current [A]."""

    direction: Direction
    horizon_s: float
    power_w: FloatArray
    low_w: FloatArray
    high_w: FloatArray
    current_a: FloatArray
    beyond_measured: BoolArray


def limits_of(cell: CellModel) -> Limits:
    """Return the limits of a cell by its file; without a largest current there, `SURGE_C`."""
    surge_a = SURGE_C * cell.capacity_ah
    limits = cell.limits
    return Limits(
        v_min_v=cell.v_min_v,
        v_max_v=cell.v_max_v,
        discharge_max_a=limits.discharge_max_a or surge_a,
        charge_max_a=limits.charge_max_a or surge_a,
        temperature_max_degc=TEMPERATURE_MAX_DEGC
        if limits.temperature_max_degc is None
        else limits.temperature_max_degc,
        heat_capacity_j_k=math.inf,
    )


def branch_currents(
    cell: CellModel, step_s: FloatArray, current_a: FloatArray, soc: FloatArray, temperature_degc: FloatArray
) -> FloatArray:
    """Return the (n_rc, n) currents through the RC resistors [A], relaxed before the first row.

    Args:
        cell: model of the cell.
        step_s: (n,) time since the row before [s].
        current_a: (n,) held over that time [A].
        soc: (n,) state of charge.
        temperature_degc: (n,) [degC].
    """
    tau_s = cell.time_constants(soc, temperature_degc)
    decay = np.exp(-step_s / tau_s)
    driven = (1.0 - decay) * np.where(step_s > UNKNOWN_S, 0.0, current_a)
    branches = np.empty_like(decay)
    for pair in range(cell.n_rc):
        now, kept, added = 0.0, decay[pair].tolist(), driven[pair].tolist()
        for row, share in enumerate(kept):
            now = share * now + added[row]
            branches[pair, row] = now
    return branches


def power_along(
    cell: CellModel,
    states: OperatingPoint,
    soc_sigma: FloatArray,
    voltage_scale: FloatArray | None = None,
    horizons_s: tuple[float, ...] = HORIZONS_S,
) -> Iterator[PowerAlong]:
    """Yield the state of power at every row, for each direction and horizon.

    Args:
        cell: model of the cell.
        states: of the cell at each of n rows.
        soc_sigma: (n,) standard deviation of the SOC.
        voltage_scale: (n,) of the sigma of a voltage, see `voltage_ahead`; None = 1.
        horizons_s: how long it is held [s].
    """
    limits = limits_of(cell)
    scale = np.ones(states.n_cells) if voltage_scale is None else voltage_scale
    for direction, full_a in (("discharge", limits.discharge_max_a), ("charge", -limits.charge_max_a)):
        for horizon_s in horizons_s:
            parts = []
            for start in range(0, states.n_cells, CHUNK_ROWS):
                rows = np.arange(start, min(start + CHUNK_ROWS, states.n_cells))
                knowledge = CellKnowledge(
                    soc_sigma[rows], capacity_sigma_frac=CAPACITY_SIGMA_FRAC, voltage_scale=scale[rows]
                )
                parts.append(_held(PowerModel(cell, limits, knowledge), states.of(rows), full_a, horizon_s))
            watts, current_a = (np.concatenate(part, axis=-1) for part in zip(*parts, strict=True))
            beyond = is_beyond_measured(cell, current_a, horizon_s)
            beyond |= cell.drop_error(states.temperature_degc) > Tuning().drop_error_max
            yield PowerAlong(direction, horizon_s, watts[1], watts[0], watts[2], current_a, beyond)  # type: ignore[arg-type]


def _held(model: PowerModel, states: OperatingPoint, full_a: float, horizon_s: float) -> tuple[FloatArray, FloatArray]:
    """Return (3, n) power, low, median and high [W], and the (n,) magnitude of the current [A]."""
    time_s = np.array(horizon_s)
    low, high = np.zeros((3, states.n_cells)), np.ones((3, states.n_cells))

    def passes(x: FloatArray) -> BoolArray:
        return np.asarray(model.margins(states, x * full_a, time_s).min(axis=0) < QUANTILES[:, None])

    low = np.where(passes(high), low, 1.0)
    for _ in range(ROUNDS):
        middle = 0.5 * (low + high)
        passed = passes(middle)
        low, high = np.where(passed, low, middle), np.where(passed, middle, high)
    current_a = low * full_a
    to = model.ahead(states, current_a, np.where(current_a < 0.0, 0.0, time_s))
    off_v = QUANTILES[:, None] * np.where(current_a < 0.0, -1.0, 1.0) * to.voltage_sigma_v
    watts = np.sort(np.maximum(np.abs(current_a) * (to.voltage_v - off_v), 0.0), axis=0)
    return watts, np.abs(current_a[1])


@dataclass(frozen=True)
class VoltageAhead:
    """The voltage of every row as it was foretold some seconds before: (n,) [V], NaN where no row was so long before.

    `scale` is that of `sigma_v` at the row, learned from those before it.
    """

    voltage_v: FloatArray
    sigma_v: FloatArray
    scale: FloatArray

    @property
    def half_band_v(self) -> FloatArray:
        """(n,) half the width of the band [V]."""
        return np.asarray(BAND_SIGMAS * self.scale * self.sigma_v)


def voltage_ahead(
    cell: CellModel,
    time_s: FloatArray,
    current_a: FloatArray,
    voltage_v: FloatArray,
    states: OperatingPoint,
    soc_sigma: FloatArray,
    ahead_s: float = AHEAD_S,
) -> VoltageAhead:
    """Return what was foretold of each row's voltage, under the current that then really flowed.

    Args:
        cell: model of the cell.
        time_s: (n,) rising [s].
        current_a: (n,) measured [A].
        voltage_v: (n,) measured [V]; the band learns from it afterwards.
        states: as estimated at each row; the RC currents follow from the current.
        soc_sigma: (n,) standard deviation of the SOC.
        ahead_s: how long before the row it is foretold [s].
    """
    moved = np.cumsum(charge_moved_coulomb(cell, current_a, np.diff(time_s, prepend=time_s[0])))
    then = np.searchsorted(time_s, time_s - ahead_s, side="right") - 1
    has_row = (then >= 0) & (time_s - time_s[np.maximum(then, 0)] < 2.0 * ahead_s)
    then = np.maximum(then, 0)
    soc = states.soc[then] - (moved - moved[then]) / (SECONDS_PER_HOUR * cell.capacity_ah)
    foretold_v = cell.terminal_voltage(soc, states.branch_a, current_a, states.temperature_degc)
    drop_v = cell.open_circuit_voltage(soc, states.temperature_degc) - foretold_v
    at_row = OperatingPoint(soc, states.branch_a, states.temperature_degc)
    sigma_v = voltage_sigma_v(cell, CellKnowledge(), at_row, soc_sigma[then], current_a, drop_v)
    foretold_v = np.where(has_row, foretold_v, np.nan)
    scale = scale_along(time_s, current_a, (voltage_v - foretold_v) / sigma_v, cell.capacity_ah)
    return VoltageAhead(foretold_v, sigma_v, scale)
