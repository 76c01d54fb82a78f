"""The balancing circuit of an accumulator: what flows in the cells while the slaves' balancing outputs are on.

The master sees only voltages and outputs, whichever circuit is built in. The slave boards of the car have resistors.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from simulator.accumulator import Accumulator
from simulator.balancing.switched_capacitor import SwitchedCapacitorEqualiser, SwitchedCapacitorParameters
from simulator.balancing.transformer import MultiWindingTransformer, TransformerParameters
from simulator.cell_data import BoolArray, FloatArray

STRONG_CAPACITORS = SwitchedCapacitorParameters(10e-3, 0.5e-3, 100e3, cell_ohm=1.6e-3, precharged=True)
STRONG_TRANSFORMER = TransformerParameters(switch_ohm=0.03, primary_ohm=0.01, secondary_ohm=0.2)


@dataclass
class Balance:
    """The effect of balancing on the cells during the next period."""

    bleeding: BoolArray | FloatArray | None = None  # on or off, or the part of the period it is on
    cell_current_a: FloatArray | None = None
    heat_w: FloatArray | None = None  # heat of switches, windings and diodes, by the cell they belong to
    loss_w: float = 0.0  # beyond the bleed resistors, which the accumulator counts


class BalancingCircuit(Protocol):
    """A circuit that the slaves' outputs switch."""

    def drive(self, outputs: FloatArray, accumulator: Accumulator, dt_s: float) -> Balance:
        """Return the currents of the next `dt_s`; `outputs` is (n_cells,), the part of it each output is on."""


class BleedResistors:
    """A resistor across each cell: charge becomes heat."""

    def drive(self, outputs: FloatArray, accumulator: Accumulator, dt_s: float) -> Balance:
        """Return the cells that bleed."""
        return Balance(bleeding=outputs)


class Transformers:
    """One multi-winding transformer per group of neighbouring cells; an output drives the winding of its cell.

    Several outputs of a group take turns.
    """

    def __init__(self, n_cells: int, parameters: TransformerParameters | None = None, *, group: int = 0) -> None:
        """Give `n_cells` transformers of `group` cells each, one for all of them if `group` is 0."""
        self._groups = _groups(n_cells, group)
        self.transformers = [
            MultiWindingTransformer(parameters or TransformerParameters(), cells.stop - cells.start)
            for cells in self._groups
        ]

    def drive(self, outputs: FloatArray, accumulator: Accumulator, dt_s: float) -> Balance:
        """Return the currents; the heat goes to the cell whose winding is driven."""
        current_a, heat_w = np.zeros(accumulator.n_cells), np.zeros(accumulator.n_cells)
        for cells, transformer in zip(self._groups, self.transformers, strict=True):
            driven = np.flatnonzero(outputs[cells])
            for cell in driven.tolist():
                moved = transformer.transfer(cell, accumulator.terminal_voltage_v[cells])
                share = float(outputs[cells][cell]) / driven.size
                current_a[cells] += share * moved.cell_current_a
                heat_w[cells.start + cell] = share * moved.loss_w
        return Balance(cell_current_a=current_a, heat_w=heat_w, loss_w=float(heat_w.sum()))


class SwitchedCapacitors:
    """A switched-capacitor equaliser per group of neighbouring cells; it runs while any output of its group is on."""

    def __init__(
        self,
        accumulator: Accumulator,
        parameters: SwitchedCapacitorParameters,
        *,
        group: int = 0,
        heat_in_cells: float = 1.0,
    ) -> None:
        """Connect to the cells; `heat_in_cells` is the part of the switches' heat that reaches them."""
        self._groups = _groups(accumulator.n_cells, group)
        self._heat_in_cells = heat_in_cells
        self.equalisers = [
            SwitchedCapacitorEqualiser(parameters, accumulator.terminal_voltage_v[cells]) for cells in self._groups
        ]
        self._cell_ohm = parameters.cell_ohm
        self._given_a = np.zeros(accumulator.n_cells)

    def drive(self, outputs: FloatArray, accumulator: Accumulator, dt_s: float) -> Balance:
        """Return the mean currents of the coming period."""
        emf_v = accumulator.terminal_voltage_v + self._given_a * self._cell_ohm
        given_a, heat_w, loss_w = np.zeros(accumulator.n_cells), np.zeros(accumulator.n_cells), 0.0
        for cells, equaliser in zip(self._groups, self.equalisers, strict=True):
            if outputs[cells].any():
                given_a[cells] = equaliser.step(dt_s, emf_v[cells])
                heat_w[cells] = self._heat_in_cells * equaliser.loss_w / (cells.stop - cells.start)
                loss_w += equaliser.loss_w
        self._given_a = given_a
        return Balance(cell_current_a=given_a, heat_w=heat_w, loss_w=loss_w)


def balancing_circuit(method: str, accumulator: Accumulator) -> BalancingCircuit:
    """Return the circuit of a method of `METHODS`, one for each pack."""
    per_pack = accumulator.parameters.cells_per_pack
    if method == "switched-capacitor":
        return SwitchedCapacitors(accumulator, STRONG_CAPACITORS, group=per_pack)
    if method == "transformer":
        return Transformers(accumulator.n_cells, STRONG_TRANSFORMER, group=per_pack)
    return BleedResistors()


def _groups(n_cells: int, group: int) -> list[slice]:
    group = group or n_cells
    return [slice(first, min(first + group, n_cells)) for first in range(0, n_cells, group)]
