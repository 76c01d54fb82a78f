"""Ageing of cells, on the shelf and by use: for scenarios that begin with an old accumulator, and seasons of them.

    capacity    1 - c,  c_cal = a_cap t^0.75,  c_cyc = b_cap sqrt(Q)
    resistance  1 + r,  r_cal = a_res t^0.75,  r_cyc = b_res Q

    a_cap = (7.543 V - 23.75) 1e6 exp(-6976 K / T)        t in days, V at rest, T in kelvin
    a_res = (5.270 V - 16.32) 1e5 exp(-5986 K / T)
    b_cap = 7.348e-3 (v - 3.667)^2 + 7.600e-4 + 4.081e-3 D      Q in Ah through a cell of 2.05 Ah, v mean voltage
    b_res = 2.153e-4 (v - 3.725)^2 - 1.521e-5 + 2.798e-4 D      D depth of discharge, 0..1

Source: Schmalstieg, Kaebitz, Ecker, Sauer, J. Power Sources 257 (2014) 325, NMC 18650. Where T, V or D change, the loss
goes on from the time (or charge) at which the new conditions would have led to it. Cells differ by a factor on each of
the two, and a cell may age faster from a day on. The estimator knows nothing of this file.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simulator.accumulator import Accumulator
from simulator.cell_data import SAMSUNG_25R_10P
from simulator.scenario import Start

FloatArray = NDArray[np.float64]
KELVIN: Final = 273.15
SPREAD: Final = 0.12  # standard deviation of the logarithm of the cells' factors
STEP_S: Final = 60.0
DAY_S: Final = 86400.0
LEAST_V: Final = 3.2  # below 3.15 V the law would heal
LAW_AH: Final = 2.05  # capacity of the cells that the law was fitted to
LOWEST_CAPACITY: Final = 0.05  # beyond what the law was fitted to, a cell is left so much


def aged(start: Start, n: int, seed: int) -> tuple[FloatArray, FloatArray]:
    """Return (n,) capacity and resistance over new ones at the start of a scenario.

    Args:
        start: how it was kept and used until then, evenly.
        n: number of cells.
        seed: of the cells' own paces: the same at any age.
    """
    return _present(start, _cells_of(start, n, seed))


class Ageing:
    """Lets the cells of an accumulator age on while they are simulated, from where a scenario starts.

    Every STEP_S of simulated time counts with the temperature and OCV of its end and with the string's current alone:
    what is bled is less than a thousandth of it. At `start.ageing` times the pace, time and charge count so often.
    """

    def __init__(self, start: Start, accumulator: Accumulator, seed: int) -> None:
        """Take the accumulator as it is at the start."""
        self._start = start
        self._accumulator = accumulator
        self._cells = _cells_of(start, accumulator.n_cells, seed)
        self._at_s, self._passed_ah = 0.0, accumulator.passed_ah

    def step(self, now_s: float) -> None:
        """Count what has passed until now; less than STEP_S waits [s]."""
        elapsed_s = now_s - self._at_s
        if elapsed_s < STEP_S:
            return
        accumulator, times = self._accumulator, self._start.ageing
        passed_ah = accumulator.passed_ah - self._passed_ah
        self._at_s, self._passed_ah = now_s, accumulator.passed_ah
        volts = np.maximum(accumulator.ocv_v, LEAST_V)
        self._cells.rest(times * elapsed_s / DAY_S, accumulator.temperature_degc, volts)
        self._cells.use(times * passed_ah * LAW_AH / accumulator.parameters.cell.capacity_ah, self._start.aged_depth)
        accumulator.age(*_present(self._start, self._cells))


def _cells_of(start: Start, n: int, seed: int) -> AgeingCells:
    cells = AgeingCells(n, np.random.default_rng((seed, n)))
    for index, times in start.paces.items():
        cells.shelf_pace[int(index)] *= times
        cells.use_pace[int(index)] *= times
    cells.rest(start.aged_days, start.aged_degc, start.aged_v)
    cells.use(start.aged_ah * LAW_AH / SAMSUNG_25R_10P.capacity_ah, start.aged_depth)
    return cells


def _present(start: Start, cells: AgeingCells) -> tuple[FloatArray, FloatArray]:
    capacity = start.capacity_ageing * np.maximum(cells.capacity, LOWEST_CAPACITY)
    return np.asarray(capacity), np.asarray(start.resistance_ageing * cells.resistance)


class AgeingCells:
    """The lasting losses of n cells; all arrays are (n,)."""

    def __init__(self, n: int, rng: np.random.Generator, spread: float = SPREAD) -> None:
        """New cells, each with its own pace."""
        self.shelf_pace = np.exp(spread * rng.standard_normal(n))
        self.use_pace = np.exp(spread * rng.standard_normal(n))
        self._shelf = np.zeros((2, n))  # c_cal, r_cal
        self._use = np.zeros((2, n))

    @property
    def capacity(self) -> FloatArray:
        """Return the capacity over that of the new cell."""
        return np.asarray(1.0 - self._shelf[0] - self._use[0])

    @property
    def resistance(self) -> FloatArray:
        """Over the new one."""
        return np.asarray(1.0 + self._shelf[1] + self._use[1])

    def rest(self, days: float, temperature_degc: ArrayLike, voltage_v: ArrayLike) -> None:
        """Stand for a while."""
        kelvin = np.asarray(temperature_degc) + KELVIN
        volts = np.asarray(voltage_v)
        rates = np.stack(
            np.broadcast_arrays(
                (7.543 * volts - 23.75) * 1e6 * np.exp(-6976.0 / kelvin) * self.shelf_pace,
                (5.270 * volts - 16.32) * 1e5 * np.exp(-5986.0 / kelvin) * self.shelf_pace,
            )
        )
        self._shelf = _go_on(self._shelf, rates, days, 0.75)

    def use(self, charge_ah: ArrayLike, depth: float, voltage_v: float = 3.7) -> None:
        """Pass charge, out and in together [Ah of a cell of 2.05 Ah]."""
        charge = np.asarray(charge_ah, dtype=np.float64)
        b_cap = 7.348e-3 * (voltage_v - 3.667) ** 2 + 7.600e-4 + 4.081e-3 * depth
        b_res = 2.153e-4 * (voltage_v - 3.725) ** 2 - 1.521e-5 + 2.798e-4 * depth
        self._use[0] = _go_on(self._use[0], b_cap * self.use_pace, charge, 0.5)
        self._use[1] += b_res * self.use_pace * charge


def _go_on(loss: FloatArray, rate: FloatArray, more: ArrayLike, power: float) -> FloatArray:
    """The loss after `more` of what it goes with, rate x^power, from where it is."""
    at = (loss / rate) ** (1.0 / power)
    return np.asarray(rate * (at + np.asarray(more, dtype=np.float64)) ** power)
