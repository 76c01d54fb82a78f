"""Multi-winding transformer, forward: the fullest cell drives its winding and the stack takes what comes out.

Solved as a circuit of voltages and resistances; ideal coupling, the magnetising current returns through the stack.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simulator.cell_data import FloatArray
from simulator.errors import ParameterError


@dataclass(frozen=True)
class TransformerParameters:
    """One primary winding with its switch per cell, one secondary with a diode over the whole stack."""

    switch_ohm: float = 0.5
    primary_ohm: float = 0.02
    secondary_ohm: float = 0.3
    diode_v: float = 0.45
    turns_per_cell: float = 1.35  # turns ratio over the number of cells; above 1 by what the losses need
    duty: float = 0.45  # the core resets in the rest of the period
    magnetising_h: float = 2.0e-4
    frequency_hz: float = 20e3
    soc_difference: float = 1e-3

    def __post_init__(self) -> None:
        if not 0.0 < self.duty <= 0.5:
            raise ParameterError("duty", self.duty, "0 to 0.5: the core has to reset")


@dataclass(frozen=True)
class Transfer:
    """What the transformer does while one cell drives it."""

    cell_current_a: FloatArray  # (n,) mean current out of each cell, negative into it
    loss_w: float  # in switch, windings and diode
    efficiency: float  # power into the stack over power out of the cell


class MultiWindingTransformer:
    """Moves charge from the fullest cell to all, one cell at a time."""

    def __init__(self, parameters: TransformerParameters, n_cells: int) -> None:
        self.parameters = parameters
        self.n_cells = n_cells

    def choose(self, soc: FloatArray) -> int | None:
        """Return the index of the cell to drain, None when (n,) SOCs lie within the threshold."""
        return int(soc.argmax()) if soc.max() - soc.min() > self.parameters.soc_difference else None

    def transfer(self, cell: int, voltage_v: FloatArray) -> Transfer:
        """Return the mean currents with the winding of `cell` switched, at the (n,) voltages.

        Switch closed: m (V - R_p I_p) = V_stack + V_d + R_s I_s with I_p = m I_s, m the turns ratio; nothing flows if
        the left side cannot reach the right. The magnetising current rises to V D T / L and falls back into the stack
        through the diode, with the energy it holds.
        """
        p = self.parameters
        ratio = p.turns_per_cell * self.n_cells
        stack_v = float(voltage_v.sum())
        cell_v = float(voltage_v[cell])
        primary_ohm = p.switch_ohm + p.primary_ohm
        secondary_a = max(0.0, ratio * cell_v - stack_v - p.diode_v) / (ratio**2 * primary_ohm + p.secondary_ohm)
        primary_a = ratio * secondary_a
        magnetising_a = cell_v * p.duty / (p.frequency_hz * p.magnetising_h)  # at the end of the on time
        stored_w = 0.5 * p.magnetising_h * magnetising_a**2 * p.frequency_hz
        returned_a = stored_w / (stack_v + p.diode_v)

        current_a = np.full(self.n_cells, -(secondary_a * p.duty + returned_a))
        drawn_a = (primary_a + 0.5 * magnetising_a) * p.duty
        current_a[cell] += drawn_a
        given_w = cell_v * drawn_a
        taken_w = stack_v * (secondary_a * p.duty + returned_a)
        return Transfer(current_a, given_w - taken_w, taken_w / given_w)
