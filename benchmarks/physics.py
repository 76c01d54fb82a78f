"""How many times faster than real time the physics runs: `python -m benchmarks.physics [--seconds S]`.

Each case steps at 10 Hz: processor time of one core, best of five rounds. Temperatures and resistances refresh once a
second inside.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np

from simulator.accumulator import Accumulator, AccumulatorParameters
from simulator.balancing.balancers import PassiveBalancing
from simulator.balancing.charge import ChargePlan, charge
from simulator.balancing.six_cells import RATED_AH, six_cells
from simulator.race import endurance

DT_S = 0.1
ROUNDS = 5


def best_step_s(step: Callable[[int], None], n_steps: int) -> float:
    """Return the shortest mean time of a step over the rounds [s]."""
    best = float("inf")
    for _ in range(ROUNDS):
        began = time.process_time()
        for k in range(n_steps):
            step(k)
        best = min(best, (time.process_time() - began) / n_steps)
    return best


def report(what: str, step: Callable[[int], None], n_steps: int) -> None:
    """Measure and print one line."""
    seconds = best_step_s(step, n_steps)
    print(f"{what:48} {seconds * 1e6:7.1f} us a step {DT_S / seconds:9,.0f} x real time")


def main() -> None:
    """Run the cases."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=300.0, help="simulated time of a round")
    n_steps = int(parser.parse_args().seconds / DT_S)

    for n_cells in (6, 96, 576):
        accumulator = Accumulator(AccumulatorParameters(n_cells=n_cells), np.random.default_rng(1))
        currents = np.random.default_rng(2).normal(20.0, 60.0, n_steps).tolist()
        report(
            f"{n_cells} cells, random current",
            lambda k, a=accumulator, i=currents: a.step(DT_S, i[k], fan_duty=0.5),  # type: ignore[misc]
            n_steps,
        )

    accumulator = Accumulator(AccumulatorParameters(), np.random.default_rng(1))
    bleeding = np.arange(96) % 2 == 0
    report("96 cells, half of them bleeding", lambda k: accumulator.step(DT_S, -6.0, bleeding=bleeding), n_steps)

    raced = Accumulator(AccumulatorParameters(start_soc=0.95), np.random.default_rng(1))
    race = endurance(np.random.default_rng(3))

    def drive(k: int) -> None:
        raced.step(DT_S, race.current_a(60.0 + k * DT_S, raced), fan_duty=0.5)

    report("96 cells in the endurance race, power to current", drive, n_steps)

    spent = []
    for _ in range(ROUNDS):
        six = Accumulator(six_cells(), np.random.default_rng(0))
        began = time.process_time()
        charge(six, PassiveBalancing(), ChargePlan(RATED_AH, dt_s=DT_S, time_limit_s=3600.0))
        spent.append(time.process_time() - began)
    print(f"{'one hour of six cells charging with balancing':48} {min(spent):7.2f} s")


if __name__ == "__main__":
    main()
