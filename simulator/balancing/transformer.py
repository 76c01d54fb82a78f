"""Multi-winding transformer, forward: one cell drives its winding and the stack takes what comes out.

Solved as a circuit of voltages and resistances; ideal coupling. A winding of its own returns the magnetising current to
the stack through a second diode, and with it the flux to where it began, before the next period.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from simulator.cell_data import FloatArray
from simulator.errors import ParameterError


@dataclass(frozen=True)
class TransformerParameters:
    """A primary winding with its switch per cell; over the stack a secondary and a reset winding, each with a diode."""

    switch_ohm: float = 0.5
    primary_ohm: float = 0.02
    secondary_ohm: float = 0.3
    diode_v: float = 0.45
    turns_per_cell: float = 1.35  # turns ratio over the number of cells; above 1 by what the losses need
    reset_turns_per_cell: float = 1.0  # turns of the reset winding; fewer reset the core sooner, at a higher voltage
    duty: float = 0.45  # the core resets in the rest of the period
    highest_over_mean: float = 1.2  # voltage of the cell that drives over the mean of the stack, up to which it does
    magnetising_h: float = 2.0e-4
    frequency_hz: float = 20e3

    def __post_init__(self) -> None:
        if not self.reset_turns_per_cell > 0.0:
            raise ParameterError("reset_turns_per_cell", self.reset_turns_per_cell, "above 0")
        longest = 1.0 / (1.0 + self.highest_over_mean * self.reset_turns_per_cell)
        if not 0.0 < self.duty <= longest:
            raise ParameterError(
                "duty", self.duty, f"above 0, at most {longest:.3g}: the core has to reset in the rest"
            )


@dataclass(frozen=True)
class Transfer:
    """The effect of the transformer while one cell drives it."""

    cell_current_a: FloatArray  # (n,) mean current out of each cell, negative into it
    loss_w: float  # in switch, windings and diode
    efficiency: float  # power into the stack over power out of the cell
    reset_share: float  # share of the period until the magnetising current is back at zero


class MultiWindingTransformer:
    """Moves charge from one cell at a time to all."""

    def __init__(self, parameters: TransformerParameters, n_cells: int) -> None:
        self.parameters = parameters
        self.n_cells = n_cells

    def transfer(self, cell: int, voltage_v: FloatArray) -> Transfer:
        """Return the mean currents with the winding of `cell` switched, at the (n,) voltages.

        Switch closed: m (V - R_p I_p) = V_stack + V_d + R_s I_s with I_p = m I_s, m the turns ratio; nothing flows if
        the left side cannot reach the right. The magnetising current rises to V D T / L. When the switch opens it flows
        through the reset winding into the stack, with the energy it holds, against (V_stack + V_d) / m_r, m_r the turns
        ratio of that winding: volt-seconds are equal after D V m_r / (V_stack + V_d) of the period.
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
        reset_share = p.duty * cell_v * p.reset_turns_per_cell * self.n_cells / (stack_v + p.diode_v)
        return Transfer(current_a, given_w - taken_w, taken_w / given_w, reset_share)
