"""Remaining energy: to the first limit, of a lap, and laps left with their band.

Cells in series give the same charge, so the first cell to reach the lowest SOC ends the race for all of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from app.estimation.arrays import FloatArray
from app.estimation.cell_model.circuit import SECONDS_PER_HOUR, CellModel
from app.estimation.errors import ModelError, ShapeError
from app.estimation.prediction.constant_current import (
    BAND_SIGMAS,
    TINY_A,
    beyond_measured,
    is_beyond_measured,
    knows_currents,
)

OCV_POINTS: Final = 33  # points of the integral over SOC
RIPPLE_S: Final = 3.0  # for which a driver holds throttle or brake
LOSS_SIGMA_FRAC: Final = 0.15  # share of the losses: driving changes
LAP_SPREAD_FRAC: Final = 0.15  # share of the lap energy, before any evidence
LAPS_MIN: Final = 2  # whole ones, before any number is given


@dataclass(frozen=True)
class EnergyLeft:
    """Energy until the first cell is empty.

    Attributes:
        energy_wh: energy the terminals still deliver at the given current [Wh].
        sigma_wh: its standard deviation, from those of SOC and capacity of the cell that ends it, of the resistances
            and of the load [Wh].
        charge_ah: charge until then [Ah].
        cell: the cell that ends it.
        beyond_measured: such a current was never measured for so long; None = the cell file does not say.
    """

    energy_wh: float
    sigma_wh: float
    charge_ah: float
    cell: int
    beyond_measured: bool | None = None

    @property
    def low_wh(self) -> float:
        """Lower end of its band [Wh]."""
        return max(self.energy_wh - BAND_SIGMAS * self.sigma_wh, 0.0)

    @property
    def high_wh(self) -> float:
        """Upper end of its band [Wh]."""
        return self.energy_wh + BAND_SIGMAS * self.sigma_wh


@dataclass(frozen=True)
class LapsLeft:
    """Laps that the energy lasts for, with a band from 5 to 95 %; `period_s` of a lap where it is known [s]."""

    laps: float
    low: float
    high: float
    lap_energy_wh: float
    lap_energy_sigma_wh: float
    period_s: float | None = None


def energy_left(
    cell: CellModel,
    soc: FloatArray,
    soc_sigma: FloatArray,
    temperature_degc: FloatArray,
    current_a: float,
    soc_min: float = 0.0,
    capacity_ah: ArrayLike | None = None,
    resistance_factor: ArrayLike = 1.0,
    capacity_sigma_ah: ArrayLike = 0.0,
    resistance_sigma: ArrayLike = 0.0,
    loss_current_a: float | None = None,
    v_min_v: float = 0.0,
    branch_a: FloatArray | None = None,
) -> EnergyLeft:
    """Return the energy until the first cell reaches the lowest SOC, or under this load the lowest voltage.

        E = sum over cells of  Q_i * integral of OCV dz - (1 + b x) drop dQ

    Args:
        cell: model of the cells.
        soc: (n_cells,) state of charge; cells with NaN are left out.
        soc_sigma: (n_cells,) its standard deviation.
        temperature_degc: (n_cells,) [degC]; NaN counts as 25.
        current_a: mean current of the driving to come [A].
        loss_current_a: mean of i^2 over mean of i, as losses grow with the square: what the ohmic drop counts with;
            an RC pair counts with less of it the slower it is; None = `current_a`, a constant current [A].
        soc_min: where a cell counts as empty.
        capacity_ah: (n_cells,) or scalar [Ah]; None = the model's.
        resistance_factor: (n_cells,) or scalar, growth of all resistances.
        capacity_sigma_ah: (n_cells,) or scalar, standard deviation of the capacities [Ah].
        resistance_sigma: (n_cells,) or scalar, standard deviation of `resistance_factor`.
        v_min_v: lowest voltage of a cell [V].
        branch_a: (n_rc, n_cells) currents through the lags now [A]; None = as the load settles them.

    Raises:
        ModelError: no cell has an SOC.
        ShapeError: the arrays differ in shape.
    """
    for name, array in (("soc_sigma", soc_sigma), ("temperature_degc", temperature_degc)):
        if array.shape != soc.shape:
            raise ShapeError(name, soc.shape, array.shape)
    finite_at = np.flatnonzero(np.isfinite(soc))
    if finite_at.size == 0:
        raise ModelError("soc", "no cell has one: nothing can be predicted")
    capacity = np.broadcast_to(np.asarray(cell.capacity_ah if capacity_ah is None else capacity_ah), soc.shape)[
        finite_at
    ]
    factor = np.broadcast_to(np.asarray(resistance_factor, dtype=np.float64), soc.shape)[finite_at]
    z = soc[finite_at]
    temperature = np.where(np.isnan(temperature_degc[finite_at]), 25.0, temperature_degc[finite_at])
    available_ah = np.maximum(z - soc_min, 0.0) * capacity
    loss_a = current_a if loss_current_a is None else loss_current_a
    lasts_s = SECONDS_PER_HOUR * float(available_ah.min()) / max(current_a, TINY_A)
    beyond = beyond_measured(cell, current_a, lasts_s)
    share = np.linspace(0.0, 1.0, OCV_POINTS)[:, None]
    now_a = None if branch_a is None else branch_a[:, None, finite_at]

    def voltage_and_drop(charge_ah: float) -> tuple[FloatArray, FloatArray]:
        path = z - share * charge_ah / capacity
        tau_s = cell.time_constants(path, temperature)
        settled_a = current_a + (loss_a - current_a) / (1.0 + tau_s / RIPPLE_S)
        passed_s = share * SECONDS_PER_HOUR * charge_ah / max(current_a, TINY_A)
        lag_a = settled_a + (0.0 if now_a is None else (now_a - settled_a) * np.exp(-passed_s / tau_s))
        drop_v = (1.0 + beyond.expected) * cell.drop_v(path, lag_a, loss_a, temperature, factor)
        return cell.open_circuit_voltage(path, temperature) - cell.hysteresis_v - drop_v, drop_v

    first, charge_ah = int(available_ah.argmin()), float(available_ah.min())
    voltage_v, drop_v = voltage_and_drop(charge_ah)
    if (is_low := voltage_v < v_min_v).any():
        row, first = (int(k) for k in np.unravel_index(int(is_low.argmax()), is_low.shape))
        above_v, below_v = voltage_v[max(row - 1, 0), first] - v_min_v, v_min_v - voltage_v[row, first]
        charge_ah *= max(row - below_v / (above_v + below_v), 0.0) / (OCV_POINTS - 1) if row else 0.0
        voltage_v, drop_v = voltage_and_drop(charge_ah)
    lost_wh = float(np.trapezoid(drop_v.sum(axis=1), share[:, 0])) * charge_ah
    mean_v = float(np.trapezoid(voltage_v.sum(axis=1), share[:, 0]))
    # sigmas of SOC and capacity of the cell that ends it are so much charge, drawn at the voltage of the end
    by_soc_ah = float(soc_sigma[finite_at][first] * capacity[first])
    sigma_ah = np.broadcast_to(np.asarray(capacity_sigma_ah, dtype=np.float64), soc.shape)[finite_at]
    by_capacity_ah = float(max(z[first] - soc_min, 0.0) * sigma_ah[first])
    shares = np.broadcast_to(np.asarray(resistance_sigma, dtype=np.float64), soc.shape)[finite_at]
    unknown = float(cell.drop_error(temperature).mean()), float(beyond.sigma)
    by_loss_wh = lost_wh * float(np.linalg.norm((float(shares.mean()), LOSS_SIGMA_FRAC, *unknown)))
    sigma_wh = float(np.hypot(np.hypot(by_soc_ah, by_capacity_ah) * voltage_v[-1].sum(), by_loss_wh))
    is_beyond = bool(is_beyond_measured(cell, current_a, lasts_s)) if knows_currents(cell) else None
    return EnergyLeft(max(mean_v * charge_ah, 0.0), sigma_wh, charge_ah, int(finite_at[first]), is_beyond)


def laps_left(energy: EnergyLeft, lap_energies_wh: ArrayLike) -> LapsLeft | None:
    """Return how many laps the energy lasts for, None before two laps with positive energy.

    The variance of n = E / e adds that of the energy, of the mean lap, and of n single laps:

        var n = (sE / e)^2 + (E sm / e^2)^2 + n (s / e)^2,   sm = s / sqrt(number of laps)

    Args:
        energy: what is left.
        lap_energies_wh: (n_laps,) energy of past laps [Wh], the newest last.
    """
    laps = np.asarray(lap_energies_wh, dtype=np.float64)
    laps = laps[np.isfinite(laps)]
    mean = float(laps.mean()) if laps.size else 0.0
    if mean <= 0.0 or laps.size < LAPS_MIN:
        return None
    prior = LAP_SPREAD_FRAC * mean
    # the spread before any evidence counts as one lap
    spread = float(np.sqrt((prior**2 + np.sum((laps - mean) ** 2)) / laps.size))
    expected = energy.energy_wh / mean
    variance = (energy.sigma_wh / mean) ** 2 + (expected * spread / mean) ** 2 / laps.size
    variance += expected * (spread / mean) ** 2
    half = BAND_SIGMAS * float(np.sqrt(variance))
    return LapsLeft(expected, max(expected - half, 0.0), expected + half, mean, spread)
