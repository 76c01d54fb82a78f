"""Heat: one lump per cell and per slave board, conduction between neighbours, coolant air that warms along its duct.

Losses come in as watts, temperatures go out. The network is linear, so a step of any length is one exact matrix
exponential, kept for every step length and fan level that occurs.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from itertools import accumulate, pairwise

import numpy as np

from simulator.cell_data import FloatArray
from simulator.errors import ParameterError

FAN_LEVELS = 32
_KEPT_STEPS = 64
_KEPT_NUMBERS = 4_000_000  # numbers in kept matrices, 32 MB


@dataclass(frozen=True)
class ThermalParameters:
    """Conductances [W/K], heat capacities [J/K] and air flow of an accumulator container.

    Cells of a pack stand in two rows: positions 0..5 along one, 6..11 back along the other. Air enters at column 0.
    Packs share ducts: with 8 packs and 4 ducts, pack 5 breathes the air that left pack 1.
    """

    cells_per_pack: int = 12
    n_ducts: int = 4
    along_row_w_per_k: float = 0.30
    across_rows_w_per_k: float = 0.20
    natural_w_per_k: float = 0.10  # still air and container walls, per cell
    forced_w_per_k: float = 1.3  # per cell at full fan
    duct_flow_w_per_k: float = 60.0  # heat capacity rate of one duct's air at full fan
    board_j_per_k: float = 40.0
    board_to_air_w_per_k: float = 0.25
    board_to_cell_w_per_k: float = 0.02

    def __post_init__(self) -> None:
        if self.cells_per_pack < 1 or self.n_ducts < 1:
            raise ParameterError("cells_per_pack, n_ducts", (self.cells_per_pack, self.n_ducts), "at least one of each")


class ThermalNetwork:
    """Temperatures of n cells and their packs' boards.

    Energy is conserved to rounding: what is put in is in the heat capacities or has gone to the ambient.
    """

    def __init__(
        self,
        parameters: ThermalParameters,
        cell_j_per_k: FloatArray,
        ambient_degc: float,
        packs: tuple[int, ...] = (),
    ) -> None:
        """Take the cells of each pack where they are not all of `cells_per_pack`."""
        self.parameters = parameters
        self.n_cells = n = len(cell_j_per_k)
        per_pack = parameters.cells_per_pack
        self.packs = packs or tuple(min(per_pack, n - first) for first in range(0, n, per_pack))
        self._starts = (0, *accumulate(self.packs))
        self.n_packs = len(self.packs)
        self.heat_capacity_j_per_k = np.concatenate(
            (cell_j_per_k, np.full(self.n_packs, parameters.board_j_per_k)),
        )
        self.node_degc = np.full(self.n_cells + self.n_packs, float(ambient_degc))
        self._passive_w_per_k = self._conduction()
        self._steps: OrderedDict[tuple[float, int], tuple[FloatArray, FloatArray]] = OrderedDict()

    @property
    def cell_degc(self) -> FloatArray:
        """(n_cells,) temperatures [degC]."""
        return self.node_degc[: self.n_cells]

    @property
    def board_degc(self) -> FloatArray:
        """(n_packs,) temperatures of the slave boards [degC]."""
        return self.node_degc[self.n_cells :]

    def step(self, dt_s: float, node_w: FloatArray, ambient_degc: float, fan_duty: float) -> None:
        """Advance by `dt_s` [s] with constant heat.

        Args:
            dt_s: length of the step, >= 0 [s].
            node_w: (n_cells + n_packs,) heat into each cell, then into each board [W].
            ambient_degc: temperature of the air that enters [degC].
            fan_duty: 0 (still) to 1, taken to the nearest of 32 levels.
        """
        kept, gained = self._step_matrices(dt_s, round(min(max(fan_duty, 0.0), 1.0) * FAN_LEVELS))
        self.node_degc[:] = ambient_degc + kept @ (self.node_degc - ambient_degc) + gained @ node_w

    def conductance_w_per_k(self, fan_duty: float) -> FloatArray:
        """Return (nodes, nodes) K of the law C dT/dt = -K (T - ambient) + heat; rows are what leaves a node."""
        return self._passive_w_per_k + self._forced_air(fan_duty)

    def _columns(self, pack: int) -> list[list[int]]:
        """Cells of a pack that stand side by side across the air flow, in the order in which the air meets them."""
        cells = list(range(self._starts[pack], self._starts[pack + 1]))
        n_columns = (len(cells) + 1) // 2
        return [
            [cells[column]] + ([cells[-1 - column]] if cells[-1 - column] != cells[column] else [])
            for column in range(n_columns)
        ]

    def _conduction(self) -> FloatArray:
        p = self.parameters
        n = self.n_cells
        conductance = np.zeros((n + self.n_packs, n + self.n_packs))

        def join(a: int, b: int, w_per_k: float) -> None:
            conductance[a, a] += w_per_k
            conductance[b, b] += w_per_k
            conductance[a, b] -= w_per_k
            conductance[b, a] -= w_per_k

        for pack in range(self.n_packs):
            columns = self._columns(pack)
            board = n + pack
            for column, following in pairwise(columns):
                for a, b in zip(column, following, strict=False):
                    join(a, b, p.along_row_w_per_k)
            for column in columns:
                if len(column) == 2:
                    join(column[0], column[1], p.across_rows_w_per_k)
                for cell in column:
                    join(cell, board, p.board_to_cell_w_per_k)
                    conductance[cell, cell] += p.natural_w_per_k
            conductance[board, board] += p.board_to_air_w_per_k
        return conductance

    def _forced_air(self, fan_duty: float) -> FloatArray:
        """Return what the moving air adds to K: each column sees the air warmed by the columns before it.

        A column of m cells takes up w (1 - exp(-m g / w)) / m per cell and kelvin from air of heat capacity rate w.
        """
        p = self.parameters
        added = np.zeros_like(self._passive_w_per_k)
        if fan_duty <= 0.0:
            return added
        flow = p.duct_flow_w_per_k * fan_duty
        per_cell = p.forced_w_per_k * fan_duty**0.8
        for duct in range(min(p.n_ducts, self.n_packs)):
            air = np.zeros(added.shape[0])  # air temperature above ambient as a sum of node temperatures
            for pack in range(duct, self.n_packs, p.n_ducts):
                for column in self._columns(pack):
                    m = len(column)
                    taken = flow * -np.expm1(-m * per_cell / flow) / m
                    gained = np.zeros_like(air)
                    for cell in column:
                        leaving = -taken * air
                        leaving[cell] += taken
                        added[cell] += leaving
                        gained += leaving
                    air = air + gained / flow
        return added

    def _step_matrices(self, dt_s: float, level: int) -> tuple[FloatArray, FloatArray]:
        key = (dt_s, level)
        matrices = self._steps.get(key)
        if matrices is None:
            rate = self.conductance_w_per_k(level / FAN_LEVELS) / self.heat_capacity_j_per_k[:, None]
            kept, integral = decay_and_integral(rate, dt_s)
            matrices = (kept, integral / self.heat_capacity_j_per_k[None, :])
            self._steps[key] = matrices
            if len(self._steps) > min(_KEPT_STEPS, max(2, _KEPT_NUMBERS // (2 * kept.size))):
                self._steps.popitem(last=False)
        else:
            self._steps.move_to_end(key)
        return matrices


def decay_and_integral(rate_per_s: FloatArray, dt_s: float) -> tuple[FloatArray, FloatArray]:
    """Return exp(-A dt) and the integral of exp(-A s) for s from 0 to dt, by Taylor series and doubling.

    Args:
        rate_per_s: (m, m) A [1/s].
        dt_s: >= 0 [s].
    """
    size = float(np.abs(rate_per_s).sum(axis=1).max()) * dt_s
    doublings = max(0, int(np.ceil(np.log2(size / 0.25)))) if size > 0.0 else 0
    short_s = dt_s / 2.0**doublings
    identity = np.eye(rate_per_s.shape[0])
    term = identity * short_s
    integral = term.copy()
    for order in range(2, 14):  # 0.25^13 / 14! is below 1e-18
        term = term @ rate_per_s * (-short_s / order)
        integral += term
    decay = identity - rate_per_s @ integral
    for _ in range(doublings):
        integral = integral + integral @ decay
        decay = decay @ decay
    return decay, integral
