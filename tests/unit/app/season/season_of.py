"""Seasons of made-up measurements."""

import numpy as np

from app.season.history import CellHistory


def history(values, sigmas, days=None, capacity=None, rest_soc=None, lost=None, car=""):
    """A history of resistances, every week one session, and of capacities where they are given."""
    n, n_cells = values.shape
    start_s = 1.79e9 + 86400.0 * (7.0 * np.arange(n) if days is None else days)
    nothing = np.full(values.shape, np.nan)
    return CellHistory(
        tuple(f"{car}s{k:02}" for k in range(n)),
        start_s,
        np.arange(1.0, n + 1.0) * 30.0,
        0.002 * values,
        values,
        sigmas,
        nothing if capacity is None else capacity * 25.0,
        nothing if capacity is None else np.full(values.shape, 0.25),
        nothing if rest_soc is None else rest_soc,
        nothing if lost is None else lost,
        np.full(values.shape, 0.0005),
        np.zeros(n_cells),
        25.0,
        np.zeros(values.shape),
        np.ones(values.shape, dtype=bool),
        True,
        car=car,
    )
