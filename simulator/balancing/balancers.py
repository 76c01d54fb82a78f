"""Balancers of the balancing thesis: once per period they look at the accumulator and say what to do.

Their circuits are those of `simulator.balancing`; the rules here know the true SOC, or the thesis's threshold.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from simulator.accumulator import Accumulator
from simulator.balancing.circuits import Balance, BalancingCircuit, Transformers
from simulator.balancing.transformer import TransformerParameters
from simulator.cell_data import BoolArray, FloatArray


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
class ThresholdBleeding:
    """Bleed each cell that stands above the lowest by more than a threshold.

    A gate is driven with (V - V_min) / `difference_v` volts and opens its MOSFET above `gate_threshold_v`, as in the
    balancing thesis; nothing bleeds once the highest cell has reached `stop_v`.
    """

    difference_v: float = 1e-4
    gate_threshold_v: float = 1.0
    stop_v: float = 4.17

    def bleeding(self, voltage_v: FloatArray) -> BoolArray:
        """Return (n,) which cells bleed at the (n,) measured voltages."""
        if voltage_v.max() >= self.stop_v:
            return np.zeros(len(voltage_v), bool)
        gate_v = (voltage_v - voltage_v.min()) / self.difference_v
        chosen: BoolArray = gate_v > self.gate_threshold_v
        return chosen


@dataclass(frozen=True)
class PassiveBalancing:
    """Bleeds by the threshold rule."""

    rule: ThresholdBleeding = field(default_factory=ThresholdBleeding)

    def decide(self, accumulator: Accumulator, period_s: float) -> Balance:
        """Return the cells to bleed at the voltages of this instant."""
        return Balance(bleeding=self.rule.bleeding(accumulator.terminal_voltage_v))


@dataclass(frozen=True)
class SocBleeding:
    """Bleeds every cell whose true SOC is above the lowest by more than `difference`.

    `measured_share` is the part of the time in which the slaves measure and hold the switches open.
    """

    difference: float = 1e-3
    measured_share: float = 0.0

    def decide(self, accumulator: Accumulator, period_s: float) -> Balance:
        """Return the part of the period in which each cell bleeds."""
        chosen: BoolArray = accumulator.soc - accumulator.soc.min() > self.difference
        part_on: FloatArray = chosen.astype(np.float64) * (1.0 - self.measured_share)
        return Balance(bleeding=part_on)


class TransformerBalancing:
    """Drives the winding of the cell with the highest true SOC in each group, while its SOCs differ enough."""

    def __init__(
        self,
        n_cells: int,
        parameters: TransformerParameters | None = None,
        *,
        group: int = 0,
        soc_difference: float = 1e-3,
    ) -> None:
        """Give `n_cells` transformers of `group` cells each, one for all of them if `group` is 0."""
        self._group = group or n_cells
        self._circuit = Transformers(n_cells, parameters, group=group)
        self._soc_difference = soc_difference

    def decide(self, accumulator: Accumulator, period_s: float) -> Balance:
        """Return the currents of one transfer in each group that is uneven."""
        outputs = np.zeros(accumulator.n_cells)
        for first in range(0, accumulator.n_cells, self._group):
            soc = accumulator.soc[first : first + self._group]
            if soc.max() - soc.min() > self._soc_difference:
                outputs[first + int(soc.argmax())] = 1.0
        return self._circuit.drive(outputs, accumulator, period_s)


@dataclass(frozen=True)
class AllOutputsOn:
    """Keeps a circuit running all the time, as switched capacitors do."""

    circuit: BalancingCircuit

    def decide(self, accumulator: Accumulator, period_s: float) -> Balance:
        """Return the currents of the coming period."""
        return self.circuit.drive(np.ones(accumulator.n_cells), accumulator, period_s)
