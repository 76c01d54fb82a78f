"""How far the accumulator still goes: energy to the first limit, energy of a lap, laps left with their band.

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

OCV_POINTS: Final = 33  # of the integral over SOC
BAND_SIGMAS: Final = 1.645  # 5 to 95 %
FIRST_LAP_SPREAD_FRAC: Final = 0.15  # of the lap energy before there are two laps to compare
LAP_PERIOD_S: Final = (30.0, 200.0)  # what a lap of a Formula Student track can take
LAP_CORRELATION_MIN: Final = 0.35  # below, the power does not repeat and there are no laps to be seen
LAP_RATE_HZ: Final = 2.0
SETTLED_LAPS: Final = 2.5  # laps that have to be driven before a period counts


@dataclass(frozen=True)
class EnergyLeft:
    """Energy until the first cell is empty.

    Attributes:
        energy_wh: energy the terminals still deliver at the given current [Wh].
        sigma_wh: its standard deviation, from those of SOC and capacity of the cell that ends it [Wh].
        charge_ah: charge until then [Ah].
        cell: the cell that ends it.
    """

    energy_wh: float
    sigma_wh: float
    charge_ah: float
    cell: int


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
) -> EnergyLeft:
    """Return the energy until the first cell reaches the lowest SOC.

        E = sum over cells of  Q_i * integral of OCV dz - (R0 + sum R_k) I * dQ - e asinh(I / i_ref) * dQ

    Args:
        cell: model of the cells.
        soc: (n_cells,) state of charge; cells with NaN are left out.
        soc_sigma: (n_cells,) its standard deviation.
        temperature_degc: (n_cells,) [degC]; NaN counts as 25.
        current_a: current of the driving to come, rms rather than mean since losses grow with its square [A].
        soc_min: where a cell counts as empty.
        capacity_ah: (n_cells,) or scalar [Ah]; None = the model's.
        resistance_factor: (n_cells,) or scalar, growth of all resistances.
        capacity_sigma_ah: (n_cells,) or scalar, standard deviation of the capacities [Ah].

    Raises:
        ModelError: no cell has an SOC.
        ShapeError: the arrays differ in shape.
    """
    for name, array in (("soc_sigma", soc_sigma), ("temperature_degc", temperature_degc)):
        if array.shape != soc.shape:
            raise ShapeError(name, soc.shape, array.shape)
    known = np.flatnonzero(np.isfinite(soc))
    if known.size == 0:
        raise ModelError("soc", "no cell has one: nothing can be predicted")
    capacity = np.broadcast_to(np.asarray(cell.capacity_ah if capacity_ah is None else capacity_ah), soc.shape)[known]
    factor = np.broadcast_to(np.asarray(resistance_factor, dtype=np.float64), soc.shape)[known]
    z = soc[known]
    temperature = np.where(np.isnan(temperature_degc[known]), 25.0, temperature_degc[known])
    available_ah = np.maximum(z - soc_min, 0.0) * capacity
    first = int(available_ah.argmin())
    charge_ah = float(available_ah[first])
    share = np.linspace(0.0, 1.0, OCV_POINTS)[:, None]
    path = z - share * charge_ah / capacity
    values = cell.parameters(path, temperature)
    drop_v = (values[0] + values[2 : 2 + cell.n_rc].sum(axis=0)) * current_a
    drop_v = factor * (drop_v + values[1] * np.arcsinh(current_a / cell.overpotential_current_a))
    voltage_v = (cell.ocv.voltage(path) - drop_v).sum(axis=1)
    mean_v = float(np.trapezoid(voltage_v, share[:, 0]))
    # sigmas of SOC and capacity of the cell that ends it are so much charge, drawn at the voltage of the end
    by_soc_ah = float(soc_sigma[known][first] * capacity[first])
    sigma_ah = np.broadcast_to(np.asarray(capacity_sigma_ah, dtype=np.float64), soc.shape)[known]
    by_capacity_ah = float(max(z[first] - soc_min, 0.0) * sigma_ah[first])
    sigma_wh = float(np.hypot(by_soc_ah, by_capacity_ah) * voltage_v[-1])
    return EnergyLeft(max(mean_v * charge_ah, 0.0), sigma_wh, charge_ah, int(known[first]))


def laps_left(energy: EnergyLeft, lap_energies_wh: ArrayLike) -> LapsLeft | None:
    """Return how many laps the energy lasts for, None before there is a lap with positive energy.

    The variance of n = E / e adds that of the energy, of the mean lap, and of n single laps:

        var n = (sE / e)^2 + (E sm / e^2)^2 + n (s / e)^2,   sm = s / sqrt(number of laps)

    Args:
        energy: what is left.
        lap_energies_wh: (n_laps,) energy of past laps [Wh], the newest last.
    """
    laps = np.asarray(lap_energies_wh, dtype=np.float64)
    laps = laps[np.isfinite(laps)]
    mean = float(laps.mean()) if laps.size else 0.0
    if mean <= 0.0:
        return None
    prior = FIRST_LAP_SPREAD_FRAC * mean
    # the spread before any evidence counts as one lap
    spread = float(np.sqrt((prior**2 + np.sum((laps - mean) ** 2)) / laps.size))
    expected = energy.energy_wh / mean
    variance = (energy.sigma_wh / mean) ** 2 + (expected * spread / mean) ** 2 / laps.size
    variance += expected * (spread / mean) ** 2
    half = BAND_SIGMAS * float(np.sqrt(variance))
    return LapsLeft(expected, max(expected - half, 0.0), expected + half, mean, spread)


def lap_period_s(time_s: FloatArray, power_w: FloatArray) -> float | None:
    """Return the time of a lap by the autocorrelation of the power [s], None where it does not repeat.

    Args:
        time_s: (n,) rising [s]; the last ten minutes are enough.
        power_w: (n,) power of the accumulator [W].
    """
    span = float(time_s[-1] - time_s[0]) if time_s.size > 1 else 0.0
    if span < SETTLED_LAPS * LAP_PERIOD_S[0]:
        return None
    grid = np.arange(0.0, span, 1.0 / LAP_RATE_HZ)
    signal = _bin_means(time_s - time_s[0], power_w, grid)
    signal = signal - signal.mean()
    n = grid.size
    spectrum = np.fft.rfft(signal, 2 * n)
    correlation = np.fft.irfft(np.abs(spectrum) ** 2)[:n]
    if correlation[0] <= 0.0:
        return None
    correlation = correlation / correlation[0] * n / (n - np.arange(n))
    first = int(LAP_PERIOD_S[0] * LAP_RATE_HZ)
    last = min(int(LAP_PERIOD_S[1] * LAP_RATE_HZ), int(n / SETTLED_LAPS))
    if last <= first + 2:
        return None
    window = correlation[first:last]
    peaks = np.flatnonzero((window[1:-1] >= window[:-2]) & (window[1:-1] > window[2:])) + 1
    peaks = peaks[window[peaks] >= LAP_CORRELATION_MIN]
    if peaks.size == 0:
        return None
    # the first peak nearly as high as the highest: later ones are two laps or more
    best = int(peaks[window[peaks] >= 0.85 * window[peaks].max()][0]) + first
    left, middle, right = correlation[best - 1 : best + 2]
    bend = left - 2.0 * middle + right
    offset = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    return float((best + offset) / LAP_RATE_HZ)


def lap_energies_wh(time_s: FloatArray, power_w: FloatArray, lap_times_s: ArrayLike) -> FloatArray:
    """Return the (n_laps,) energy between successive lap marks [Wh].

    Args:
        time_s: (n,) rising [s].
        power_w: (n,) power of the accumulator, positive on discharge [W].
        lap_times_s: (n_laps + 1,) when the line was crossed [s], rising; from a beacon, markers or `lap_period_s`.
    """
    marks = np.asarray(lap_times_s, dtype=np.float64)
    mean_w = 0.5 * (power_w[1:] + power_w[:-1])
    energy = np.concatenate(([0.0], np.cumsum(mean_w * np.diff(time_s)))) / SECONDS_PER_HOUR
    return np.diff(np.interp(marks, time_s, energy))


def _bin_means(time_s: FloatArray, values: FloatArray, grid_s: FloatArray) -> FloatArray:
    """Return the mean value in each cell of an even grid, interpolated where no sample falls."""
    index = np.clip(np.searchsorted(grid_s, time_s, side="right") - 1, 0, grid_s.size - 1)
    known = np.isfinite(values)
    count = np.bincount(index[known], minlength=grid_s.size)
    total = np.bincount(index[known], values[known], minlength=grid_s.size)
    filled = count > 0
    return np.interp(grid_s, grid_s[filled], total[filled] / count[filled])
