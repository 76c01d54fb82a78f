"""Balancers as a charge or a rest sees them: once per period they look at the accumulator and say what to do.

The circuits are in `passive`, `switched_capacitor` and `transformer`; here they are given cells, in groups of a pack.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from simulator.accumulator import Accumulator
from simulator.balancing.passive import Ltc6804Discharge, ThresholdBleeding
from simulator.balancing.switched_capacitor import SwitchedCapacitorEqualiser, SwitchedCapacitorParameters
from simulator.balancing.transformer import MultiWindingTransformer, TransformerParameters
from simulator.cell_data import BoolArray, FloatArray


@dataclass
class Balance:
    """What a balancer wants for the next period."""

    bleeding: BoolArray | FloatArray | None = None  # on or off, or the part of the period it is on
    cell_current_a: FloatArray | None = None
    heat_w: FloatArray | None = None  # into each cell, from switches beside it
    loss_w: float = 0.0  # beyond the bleed resistors, which the accumulator counts


class Balancer(Protocol):
    """Decides once per period."""

    def decide(self, accumulator: Accumulator, period_s: float) -> Balance:
        """Return what to do during the coming period."""


class NoBalancing:
    """Leaves the cells alone."""

    def decide(self, accumulator: Accumulator, period_s: float) -> Balance:
        """Return nothing to do."""
        return Balance()


@dataclass(frozen=True)
class PassiveBalancing:
    """Bleeds by the threshold rule."""

    rule: ThresholdBleeding = field(default_factory=ThresholdBleeding)

    def decide(self, accumulator: Accumulator, period_s: float) -> Balance:
        """Return the cells to bleed at the voltages of this instant."""
        return Balance(bleeding=self.rule.bleeding(accumulator.terminal_voltage_v))


@dataclass(frozen=True)
class SocBleeding:
    """Bleeds every cell whose true SOC is above the lowest by more than `difference`: passive, all-knowing."""

    difference: float = 1e-3

    def decide(self, accumulator: Accumulator, period_s: float) -> Balance:
        """Return the cells to bleed."""
        chosen: BoolArray = accumulator.soc - accumulator.soc.min() > self.difference
        return Balance(bleeding=chosen)


class ChipBleeding:
    """What an LTC6804 makes of another balancer's wishes: off while it measures, as often as the master asks it to."""

    def __init__(self, wishes: Balancer, n_cells: int, *, conversion_s: float, measure_every_s: float) -> None:
        """Forward `wishes`; conversions of `conversion_s` with discharge forbidden start every `measure_every_s`."""
        self._wishes = wishes
        self._chip = Ltc6804Discharge(n_cells)
        self._conversion_s = conversion_s
        self._measure_every_s = measure_every_s

    def decide(self, accumulator: Accumulator, period_s: float) -> Balance:
        """Return the mean part of the period for which each resistor is on."""
        wanted = self._wishes.decide(accumulator, period_s).bleeding
        if wanted is None:
            return Balance()
        self._chip.write(wanted.astype(bool))
        on_s, slices = 0.0, max(1, round(period_s / self._measure_every_s))
        for _ in range(slices):
            self._chip.measure(self._conversion_s)
            _, part = self._chip.step(period_s / slices)
            on_s += part * period_s / slices
        part_on: FloatArray = np.asarray(wanted, dtype=float) * (on_s / period_s)
        return Balance(bleeding=part_on)


class TransformerBalancing:
    """One transformer per group of neighbouring cells; the switch's heat goes to the cell that drives it."""

    def __init__(self, n_cells: int, parameters: TransformerParameters | None = None, *, group: int = 0) -> None:
        """Give `n_cells` transformers of `group` cells each, one for all of them if `group` is 0."""
        group = group or n_cells
        self._groups = [slice(first, min(first + group, n_cells)) for first in range(0, n_cells, group)]
        self._transformers = [
            MultiWindingTransformer(parameters or TransformerParameters(), cells.stop - cells.start)
            for cells in self._groups
        ]

    def decide(self, accumulator: Accumulator, period_s: float) -> Balance:
        """Return the currents of one transfer in each group that is uneven."""
        current_a, heat_w = np.zeros(accumulator.n_cells), np.zeros(accumulator.n_cells)
        for cells, transformer in zip(self._groups, self._transformers, strict=True):
            chosen = transformer.choose(accumulator.soc[cells])
            if chosen is not None:
                moved = transformer.transfer(chosen, accumulator.terminal_voltage_v[cells])
                current_a[cells] = moved.cell_current_a
                heat_w[cells.start + chosen] = moved.loss_w
        return Balance(cell_current_a=current_a, heat_w=heat_w, loss_w=float(heat_w.sum()))


class CapacitorBalancing:
    """A switched-capacitor equaliser per group of neighbouring cells, running all the time."""

    def __init__(
        self,
        accumulator: Accumulator,
        parameters: SwitchedCapacitorParameters,
        *,
        group: int = 0,
        heat_in_cells: float = 1.0,
    ) -> None:
        """Connect to the cells; `heat_in_cells` is the part of the switches' heat that reaches them."""
        n = accumulator.n_cells
        group = group or n
        self._heat_in_cells = heat_in_cells
        self._groups = [slice(first, min(first + group, n)) for first in range(0, n, group)]
        self.equalisers = [
            SwitchedCapacitorEqualiser(parameters, accumulator.terminal_voltage_v[cells]) for cells in self._groups
        ]
        self._cell_ohm = parameters.cell_ohm
        self._given_a = np.zeros(n)

    def decide(self, accumulator: Accumulator, period_s: float) -> Balance:
        """Return the mean currents of the coming period."""
        emf_v = accumulator.terminal_voltage_v + self._given_a * self._cell_ohm
        given_a, heat_w, loss_w = np.empty(accumulator.n_cells), np.empty(accumulator.n_cells), 0.0
        for cells, equaliser in zip(self._groups, self.equalisers, strict=True):
            given_a[cells] = equaliser.step(period_s, emf_v[cells])
            heat_w[cells] = self._heat_in_cells * equaliser.loss_w / (cells.stop - cells.start)
            loss_w += equaliser.loss_w
        self._given_a = given_a
        return Balance(cell_current_a=given_a, heat_w=heat_w, loss_w=loss_w)
