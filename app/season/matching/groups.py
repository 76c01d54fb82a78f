"""Which cells in parallel: groups of equal size whose capacities and resistances differ least.

In a string the group with the least capacity ends the run and the one with the most resistance meets the lower voltage
limit first. Inside a group the cell that resists least carries most: its share of the current is what heats and ages
it. So the cost of a build is

    spread of group capacity / typical + spread of group resistance / typical + weight x spread of shares inside

each a standard deviation. From groups filled in turns (1, 2 .. S, S .. 2, 1 in order of capacity) pairs of cells are
exchanged as long as that lessens the cost.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.errors import ConfigError
from app.estimation.arrays import FloatArray

INSIDE_WEIGHT: Final = 0.2
TRIES_PER_CELL: Final = 60
RANDOM_BUILDS: Final = 200
IndexArray = NDArray[np.intp]


@dataclass(frozen=True)
class Build:
    """(groups, parallel) indices of the cells, and what they make: spreads are standard deviations over the mean.

    Attributes:
        cells: which cells are in parallel.
        capacity_ah: (groups,) sum of a group.
        resistance_ohm: (groups,) of a group.
        capacity_spread: of the groups.
        resistance_spread: of the groups.
        usable: least group capacity over the mean of all: what of the bought capacity a string can use.
        share_max: largest share of current that a cell carries, over an equal share.
        cost: what is minimised.
    """

    cells: IndexArray
    capacity_ah: FloatArray
    resistance_ohm: FloatArray
    capacity_spread: float
    resistance_spread: float
    usable: float
    share_max: float
    cost: float


def build_of(cells: IndexArray, capacity_ah: FloatArray, resistance_ohm: FloatArray) -> Build:
    """Return what (groups, parallel) indices make of cells."""
    conductance = 1.0 / resistance_ohm[cells]
    capacity, total = capacity_ah[cells].sum(axis=1), conductance.sum(axis=1)
    shares = conductance / total[:, None] * cells.shape[1]
    spreads = _relative(capacity), _relative(1.0 / total)
    return Build(
        cells,
        capacity,
        1.0 / total,
        *spreads,
        float(capacity.min() / capacity.mean()),
        float(shares.max()),
        spreads[0] + spreads[1] + INSIDE_WEIGHT * float(shares.std()),
    )


def match_groups(capacity_ah: FloatArray, resistance_ohm: FloatArray, parallel: int, seed: int = 0) -> Build:
    """Return the build that was found for (n,) cells; the same each time.

    Raises:
        ConfigError: the cells do not fill groups of `parallel`, or a number is not positive.
    """
    check_cells(capacity_ah, resistance_ohm, parallel)
    cells = snake(capacity_ah, parallel)
    n_groups = len(cells)
    best = build_of(cells, capacity_ah, resistance_ohm)
    if n_groups < 2 or parallel == 1:
        return best
    rng = np.random.default_rng(seed)
    tries = rng.integers(0, (n_groups, n_groups, parallel, parallel), (TRIES_PER_CELL * capacity_ah.size, 4))
    cells, conductance = cells.copy(), 1.0 / resistance_ohm
    sums = np.array((capacity_ah[cells].sum(axis=1), conductance[cells].sum(axis=1)))
    squares = (conductance[cells] ** 2).sum(axis=1)
    cost = _cost(sums, squares, parallel)
    for a, b, i, k in tries.tolist():
        if a == b:
            continue
        out, other = cells[a, i], cells[b, k]
        more = np.array((capacity_ah[other] - capacity_ah[out], conductance[other] - conductance[out]))
        more2 = conductance[other] ** 2 - conductance[out] ** 2
        sums[:, a] += more
        sums[:, b] -= more
        squares[a] += more2
        squares[b] -= more2
        trial = _cost(sums, squares, parallel)
        if trial < cost:
            cost = trial
            cells[a, i], cells[b, k] = other, out
        else:
            sums[:, a] -= more
            sums[:, b] += more
            squares[a] -= more2
            squares[b] += more2
    return build_of(cells, capacity_ah, resistance_ohm)


def sorted_groups(capacity_ah: FloatArray, resistance_ohm: FloatArray, parallel: int) -> Build:
    """Return the build of neighbours in order of capacity: like with like, as cells are often matched."""
    check_cells(capacity_ah, resistance_ohm, parallel)
    return build_of(np.argsort(capacity_ah, kind="stable").reshape(-1, parallel), capacity_ah, resistance_ohm)


def random_groups(
    capacity_ah: FloatArray, resistance_ohm: FloatArray, parallel: int, builds: int = RANDOM_BUILDS, seed: int = 0
) -> list[Build]:
    """Return builds of cells as they come out of the box, the best first."""
    check_cells(capacity_ah, resistance_ohm, parallel)
    rng = np.random.default_rng(seed)
    made = [
        build_of(rng.permutation(capacity_ah.size).reshape(-1, parallel), capacity_ah, resistance_ohm)
        for _ in range(builds)
    ]
    return sorted(made, key=lambda build: build.cost)


def snake(values: FloatArray, parallel: int) -> IndexArray:
    """Return groups filled in turns there and back, in falling order."""
    rounds = np.argsort(-values, kind="stable").reshape(parallel, -1)
    rounds[1::2] = rounds[1::2, ::-1]
    return np.ascontiguousarray(rounds.T)


def check_cells(capacity_ah: FloatArray, resistance_ohm: FloatArray, parallel: int) -> None:
    """Raise ConfigError for cells of which no groups can be made."""
    if parallel < 1 or capacity_ah.size == 0 or capacity_ah.size % parallel:
        raise ConfigError("parallel", parallel, f"a divisor of {capacity_ah.size}, the number of cells")
    for name, values in (("capacity_ah", capacity_ah), ("resistance_ohm", resistance_ohm)):
        if not (np.isfinite(values).all() and (values > 0.0).all()):
            raise ConfigError(name, float(values[~(values > 0.0)][0]), "positive, of every cell")


def _relative(values: FloatArray) -> float:
    return float(values.std() / values.mean())


def _cost(sums: FloatArray, squares: FloatArray, parallel: int) -> float:
    """`Build.cost`, of sums of capacity and conductance and of squared conductances of each group."""
    capacity, total = sums
    shares2 = float((squares / total**2).mean()) * parallel - 1.0
    return _relative(capacity) + _relative(1.0 / total) + INSIDE_WEIGHT * float(np.sqrt(max(shares2, 0.0)))
