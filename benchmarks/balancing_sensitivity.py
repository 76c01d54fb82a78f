"""Sensitivity of the balancing study to values that the thesis does not give.

`python -m benchmarks.balancing_sensitivity` prints two tables: what decides how long resistors are on, and what
decides whether a charge at 6C with the transformer trips at 40 degC. Method: one change at a time.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from simulator.accumulator import Accumulator, AccumulatorParameters
from simulator.balancing.balancers import ThresholdBleeding, TransformerBalancing
from simulator.balancing.charge import ChargePlan, Supervisor, charge
from simulator.balancing.circuits import Balance
from simulator.balancing.six_cells import RATED_AH, six_cells
from simulator.cell_data import BoolArray, FloatArray

UNSUPERVISED = Supervisor(max_degc=99.0)
CASES = ((20.0, 0.25), (20.0, 0.5), (40.0, 0.5))


class ImperfectSampling:
    """The thesis's rule on voltages that are noisy, filtered, old, or acted on late."""

    def __init__(
        self, *, noise_v: float = 0.0, filter_s: float = 0.0, old_samples: int = 0, closes_after: int = 1
    ) -> None:
        self._noise_v = noise_v
        self._filter_s = filter_s
        self._old_samples = old_samples
        self._closes_after = closes_after  # looks in a row that ask for it; a switch opens at once
        self._rule = ThresholdBleeding()
        self._rng = np.random.default_rng(1)
        self._filtered_v: FloatArray | None = None
        self._seen_v: list[FloatArray] = []
        self._asked = np.zeros(0, dtype=int)
        self._on: BoolArray = np.zeros(0, dtype=bool)
        self._on_s = self._cell_s = 0.0

    @property
    def on_share(self) -> float:
        """Mean part of the charge for which a resistor was on."""
        return self._on_s / self._cell_s

    def decide(self, accumulator: Accumulator, period_s: float) -> Balance:
        """Return the cells to bleed."""
        wanted = self._rule.bleeding(self._sample(accumulator.terminal_voltage_v, period_s))
        if not len(self._asked):
            self._asked, self._on = np.zeros(len(wanted), dtype=int), np.zeros(len(wanted), dtype=bool)
        self._asked = np.where(wanted, self._asked + 1, 0)
        self._on = wanted & (self._on | (self._asked >= self._closes_after))
        self._on_s += float(self._on.sum()) * period_s
        self._cell_s += len(wanted) * period_s
        return Balance(bleeding=self._on)

    def _sample(self, voltage_v: FloatArray, period_s: float) -> FloatArray:
        seen_v = voltage_v + self._noise_v * self._rng.standard_normal(len(voltage_v))
        if self._filter_s:
            before_v = seen_v if self._filtered_v is None else self._filtered_v
            seen_v = self._filtered_v = before_v + (seen_v - before_v) * -math.expm1(-period_s / self._filter_s)
        self._seen_v = [*self._seen_v, seen_v][-1 - self._old_samples :]
        return self._seen_v[0]


def bleeding() -> None:
    """Print hours, hottest cell, final difference and on-time for one change at a time."""
    changes: dict[str, tuple[dict[str, float], dict[str, int | float]]] = {
        "as in the tables: every second, at once, exact": ({}, {}),
        "every 0.1 s": ({"control_period_s": 0.1, "dt_s": 0.1}, {}),
        "every 10 s": ({"control_period_s": 10.0}, {}),
        "every 30 s": ({"control_period_s": 30.0}, {}),
        "on voltages three looks old": ({}, {"old_looks": 3}),
        "noise of 0.1 mV": ({}, {"noise_v": 1e-4}),
        "filtered, 5 s": ({}, {"filter_s": 5.0}),
        "filtered, 12 s": ({}, {"filter_s": 12.0}),
        "closes at the second look that asks for it": ({}, {"closes_after": 2}),
        "closes at the third": ({}, {"closes_after": 3}),
    }
    print("\n| what the logic does | " + " | ".join(f"{ohm:g} ohm, {c}C" for ohm, c in CASES) + " |")
    print("|---" * (1 + len(CASES)) + "|")
    for name, (plan, sample) in changes.items():
        row = []
        for ohm, c_rate in CASES:
            logic = ImperfectSampling(**sample)  # type: ignore[arg-type]
            accumulator = Accumulator(six_cells(bleed_ohm=ohm), np.random.default_rng(0))
            result = charge(accumulator, logic, ChargePlan(c_rate * RATED_AH, **plan), UNSUPERVISED)
            row.append(
                f"{result.hours:.2f} / {result.max_degc:.1f} / {100 * result.soc_difference:.3f}"
                f" / {100 * logic.on_share:.0f} %"
            )
        print(f"| {name} | " + " | ".join(row) + " |")


def transformer() -> None:
    """Print the hottest cell at 5C and 6C for one change at a time."""
    base = six_cells()

    def cooled(share: float) -> AccumulatorParameters:
        thermal = base.thermal
        names = ("along_row_w_per_k", "across_rows_w_per_k", "natural_w_per_k")
        return dataclasses.replace(
            base, thermal=dataclasses.replace(thermal, **{name: share * getattr(thermal, name) for name in names})
        )

    lighter = dataclasses.replace(base.cell, heat_capacity_j_per_k=0.95 * base.cell.heat_capacity_j_per_k)
    changes = {
        "as in the table": base,
        "5 % more resistance": dataclasses.replace(base, resistance_ageing=1.05),
        "5 % less heat capacity": dataclasses.replace(base, cell=lighter),
        "10 % less convection": cooled(0.9),
        "air 1 K warmer": six_cells(ambient_degc=24.0),
    }
    print("\n| change | 5C | 6C |\n|---|---|---|")
    for name, parameters in changes.items():
        hottest = []
        for c_rate in (5.0, 6.0):
            accumulator = Accumulator(parameters, np.random.default_rng(0))
            plan = ChargePlan(c_rate * RATED_AH)
            hottest.append(charge(accumulator, TransformerBalancing(6), plan, UNSUPERVISED).max_degc)
        print(f"| {name} | {hottest[0]:.1f} | {hottest[1]:.1f} |")


def main() -> None:
    """Print both tables."""
    bleeding()
    transformer()


if __name__ == "__main__":
    main()
