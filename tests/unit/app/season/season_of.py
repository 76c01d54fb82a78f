"""Seasons of simulated cells: the simulator ages them, measurements are drawn about the truth."""

from dataclasses import dataclass

import numpy as np

from app.season.cells.history import CellHistory
from simulator.ageing import AgeingCells


@dataclass
class SimulatedSeason:
    """(n + 1,) and (n + 1, cells): sessions and one time 90 days after the last."""

    days: np.ndarray
    charge_ah: np.ndarray
    capacity: np.ndarray
    resistance: np.ndarray
    rng: np.random.Generator

    def measured(self, truth, sigma, missing):
        """Values and sigmas of the sessions."""
        sigmas = sigma * self.rng.uniform(0.7, 1.5, truth[:-1].shape)
        values = truth[:-1] + sigmas * self.rng.standard_normal(sigmas.shape)
        values[self.rng.random(values.shape) < missing] = np.nan
        return values, sigmas


def season(seed, n_cells=96, n=60, years=1.5):
    """Return a season and a half of driving about twice a fortnight."""
    rng = np.random.default_rng(seed)
    cells = AgeingCells(n_cells, rng)
    days = np.sort(rng.uniform(0.0, 365.0 * years, n))
    days -= days[0]
    days = np.append(days, days[-1] + 90.0)
    capacity, resistance, charge, total = [], [], [], 0.0
    for gap, day in zip(np.diff(days, prepend=0.0), days, strict=True):
        if gap > 0.0:
            warm = 22.0 + 6.0 * np.sin(2 * np.pi * day / 365.0) + 0.5 * rng.standard_normal(n_cells)
            cells.rest(gap, warm, 3.75 + 0.1 * rng.random())
        passed = 1.5 * rng.uniform(1.5, 4.0)
        cells.use(passed, 0.75)
        total += passed
        capacity.append(cells.capacity.copy())
        resistance.append(cells.resistance.copy())
        charge.append(total)
    return SimulatedSeason(days, np.array(charge), np.array(capacity), np.array(resistance), rng)


def history(values, sigmas, days=None, capacity=None, rest_soc=None, lost=None, car=""):
    """A history of resistances, every week one session, and of capacities where they are given."""
    n, n_cells = values.shape
    start_s = 1.79e9 + 86400.0 * (7.0 * np.arange(n) if days is None else days)
    nothing = np.full(values.shape, np.nan)
    return CellHistory(
        tuple(f"{car}s{k:02}" for k in range(n)),
        start_s,
        np.arange(1.0, n + 1.0) * 30.0,
        values,
        sigmas,
        nothing if capacity is None else capacity * 25.0,
        nothing if capacity is None else np.full(values.shape, 0.25),
        nothing if rest_soc is None else rest_soc,
        nothing if lost is None else lost,
        np.full(values.shape, 0.0005),
        np.zeros(n_cells),
        25.0,
        np.ones(values.shape, dtype=bool),
        True,
        car=car,
    )
