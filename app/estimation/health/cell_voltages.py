"""The voltages of a stretch as the fits of each cell take them: thinned, with their noise and the current they show."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from app.estimation.arrays import FloatArray, IntArray, row_median
from app.estimation.cell_model.circuit import SECONDS_PER_HOUR, CellModel
from app.estimation.health.stretch import Stretch

FULL_RATE_S: Final = 8.0  # around the instant that is asked about every sample counts
SPACING_S: Final = 1.0  # elsewhere one a second
LEAST_NOISE_V: Final = 1.5e-3
LAG_SHARE: Final = (
    0.3  # share of what a cell moves by from sample to sample: the master's low pass, and when it was measured
)
SHOWN_LAG_SHARE: Final = 0.1  # and where the typical cell shows both
LAGS: Final = (-1, 0, 1, 2)  # samples by which voltages may lead or follow the current
SHOWN_S: Final = 1.1  # movement within it is taken from the typical cell's voltage, slower one from the current
QUICK_S: Final = 0.3  # between samples: less often shows no lag
FEWEST: Final = 100  # steps of the current that show it
MOVED_A: Final = 3.0
LIKELY_OHM: Final = (0.3, 3.0)  # shares of the model's resistance: beyond them something else moved the voltage
USUAL_DEGC: Final = 25.0
CHARGE_RANGE: Final = (-0.05, 1.05)
CHARGE_STEP: Final = 0.005
LESS_CHARGE: Final = np.arange(-220, 221) * CHARGE_STEP


@dataclass(frozen=True)
class CellVoltage:
    """The thinned voltage of a cell that the laws are fitted to; arrays are (m,)."""

    time_s: FloatArray
    current_a: FloatArray  # as the voltages show it, where they do: see `shown_current`
    used: FloatArray  # charge used since the beginning, of the median cell's capacity
    soc: FloatArray
    branch_a: FloatArray  # (n_rc, m) through each RC pair
    voltage_v: FloatArray
    median_v: FloatArray
    noise_v: FloatArray
    around_s: float  # the instant that is asked about

    @property
    def deviation_v(self) -> FloatArray:
        """The cell against the median cell."""
        return self.voltage_v - self.median_v


def slow_current(time_s: FloatArray, current_a: FloatArray, tau_s: float) -> FloatArray:
    """Return the (n,) current through an RC pair, i' = a i + (1 - a) current, a = exp(-dt / tau)."""
    keep = np.exp(-np.diff(time_s, prepend=time_s[:1]) / tau_s)
    out = np.empty_like(current_a)
    held = 0.0
    for k, (share, amps) in enumerate(zip(keep.tolist(), current_a.tolist(), strict=True)):
        held = share * held + (1.0 - share) * amps
        out[k] = held
    return out


def shown_current(stretch: Stretch, model: CellModel, branch_a: FloatArray) -> FloatArray | None:
    """Return the (n,) current at the instants and with the low pass of the voltages; None where nothing shows it.

    The current is a mean over what lies between two samples, a voltage is of one instant and filtered: against the one
    a drop of the other looks too small. All cells are measured alike, so the typical cell's drop is the clock:

        d(median) = -sum_l b_l d(i(k - l)) - sum_j R_j d(branch_j)        by least squares
        shown = sum_l b_l i(k - l) / R,  R = sum_l b_l;  its quick part from -(median + sum_j R_j branch_j) / R

    Args:
        stretch: the samples.
        model: of the cells.
        branch_a: (n_rc, n) current through each RC pair [A].
    """
    current, median_v = np.nan_to_num(stretch.current_a), stretch.median_v
    spacing_s = np.diff(stretch.time_s)
    if not spacing_s.size or not 0.0 < (usual_s := float(np.median(spacing_s))) <= QUICK_S:
        return None
    lagged = np.array([np.roll(current, lag) for lag in LAGS])
    columns = np.diff(np.concatenate((lagged, branch_a)), axis=1)
    moved_v = np.diff(median_v)
    is_usable = np.isfinite(moved_v) & (np.abs(spacing_s - usual_s) < 0.5 * usual_s)
    is_usable[: len(LAGS)] = is_usable[-len(LAGS) :] = False
    if (is_usable & (np.abs(columns[LAGS.index(0)]) > MOVED_A)).sum() < FEWEST:
        return None
    solution = -np.linalg.lstsq(columns[:, is_usable].T, moved_v[is_usable], rcond=None)[0]
    weights, pairs_ohm = solution[: len(LAGS)], solution[len(LAGS) :]
    ohm, usual_ohm = float(weights.sum()), resistances(model)[0]
    if not LIKELY_OHM[0] * usual_ohm < ohm < LIKELY_OHM[1] * usual_ohm:
        return None
    shifted = weights @ lagged / ohm
    by_voltage = -(median_v + pairs_ohm @ branch_a) / ohm
    apart = np.where(np.isfinite(by_voltage), by_voltage - shifted, 0.0)
    n = 2 * round(0.5 * SHOWN_S / usual_s) + 1
    if len(apart) < n:
        return None
    around = np.lib.stride_tricks.sliding_window_view(np.pad(apart, n // 2, mode="edge"), n)
    slow = np.median(around, axis=1)  # a mean would spread a step of the current over its neighbours
    return np.asarray(shifted + apart - slow)


def resistances(model: CellModel) -> tuple[float, FloatArray]:
    """Return what a current drops at once, and (n_rc,) what it drops by each lag, at 3C and half charge [ohm]."""
    amps = 3.0 * model.c_rate_a
    at_once_v = float(model.drop_v(0.5, np.zeros(model.n_rc), amps, USUAL_DEGC))
    lagged_v = [float(model.drop_v(0.5, one, amps, USUAL_DEGC)) for one in amps * np.eye(model.n_rc)]
    return at_once_v / amps, (np.array(lagged_v) - at_once_v) / amps


class UnderLoad:
    """The voltage of a cell with another charge, at the recorded current.

    The searches ask for it some hundred times a cell: it is made once for each step of charge, and read between them.
    """

    def __init__(self, cell: CellVoltage, model: CellModel) -> None:
        self._soc, self._columns = cell.soc, np.arange(cell.soc.size)
        soc = np.clip(cell.soc - LESS_CHARGE[:, None], *CHARGE_RANGE)
        branch_a = np.broadcast_to(cell.branch_a[:, None], (model.n_rc, *soc.shape))
        self._voltage_v = model.terminal_voltage(soc, branch_a, cell.current_a, USUAL_DEGC)
        self._usual_v = self._read(np.zeros(cell.soc.size))

    def moved_v(self, soc: FloatArray) -> FloatArray:
        """Return the (m,) voltage at a charge against that at the recorded one [V]."""
        return self._read(self._soc - soc) - self._usual_v

    def _read(self, less: FloatArray) -> FloatArray:
        at = np.clip((less - LESS_CHARGE[0]) / CHARGE_STEP, 0.0, len(LESS_CHARGE) - 1.001)
        row = at.astype(np.intp)
        low, high = self._voltage_v[row, self._columns], self._voltage_v[row + 1, self._columns]
        return np.asarray(low + (at - row) * (high - low))


class CellVoltages:
    """The voltages of a stretch as the fits want them: made once, asked for cell by cell."""

    def __init__(self, stretch: Stretch, model: CellModel, around_s: float) -> None:
        self._stretch = stretch
        self._around_s = around_s
        time_s = stretch.time_s
        current = np.nan_to_num(stretch.steady_a)
        self._rows = _thinned(time_s, around_s)
        dt_s = np.clip(np.diff(time_s, prepend=time_s[:1]), 0.0, 10.0)
        used = np.cumsum(current * dt_s) / (SECONDS_PER_HOUR * model.capacity_ah)
        branches = [slow_current(time_s, current, float(tau_s.mean())) for tau_s in model.tau_s]
        shown = shown_current(stretch, model, np.array(branches).reshape(-1, len(time_s)))
        self._lag_share = LAG_SHARE if shown is None else SHOWN_LAG_SHARE
        is_finite = np.isfinite(stretch.soc)
        start = float(stretch.soc[is_finite][0] + used[is_finite][0]) if is_finite.any() else 0.5
        self._shared = tuple(
            values[self._rows] for values in (time_s, current if shown is None else shown, used, start - used)
        )
        self._branches = np.array(branches).reshape(-1, len(time_s))[:, self._rows]
        apart = stretch.deviation_v[self._rows]
        usual = 1.4826 * row_median(np.abs(apart - row_median(apart.T)))
        self._noise = np.hypot(np.nan_to_num(usual), LEAST_NOISE_V)

    def of(self, cell: int) -> CellVoltage | None:
        """Return one cell, None where it was hardly measured."""
        voltage = self._stretch.voltage_v[self._rows, cell]
        middle = self._stretch.median_v[self._rows]
        is_finite = np.isfinite(voltage) & np.isfinite(middle)
        if is_finite.sum() < 10:
            return None
        time_s, current, used, soc = (values[is_finite] for values in self._shared)
        noise = np.hypot(
            self._noise[is_finite], self._lag_share * _movement(time_s, voltage[is_finite] - middle[is_finite])
        )
        branches, voltage, middle = self._branches[:, is_finite], voltage[is_finite], middle[is_finite]
        return CellVoltage(time_s, current, used, soc, branches, voltage, middle, noise, self._around_s)


def _movement(time_s: FloatArray, deviation_v: FloatArray) -> FloatArray:
    """How far a deviation moves, to or from each of its samples where they follow each other at full rate [V]."""
    steps = np.where(np.diff(time_s) < 0.5 * SPACING_S, np.abs(np.diff(deviation_v)), 0.0)
    moved: FloatArray = np.maximum(np.append(steps, 0.0), np.insert(steps, 0, 0.0))
    return moved


def _thinned(time_s: FloatArray, around_s: float) -> IntArray:
    near = np.abs(time_s - around_s) <= FULL_RATE_S
    second = np.floor(time_s / SPACING_S)
    first = np.diff(second, prepend=-1.0) > 0
    return np.flatnonzero(near | first)
