"""How many times real time the virtual master runs: race, physics, measuring, framing at 10 Hz, line pacing.

Method: the default scenario from its tenth second on, streaming, `--passes` stretches of `--seconds` virtual seconds in
passes of 20 ms; processor time of this process, best and median stretch.
"""

import argparse
import statistics
import time

from simulator.arguments import DEFAULT_SCENARIO
from simulator.library import find_scenario
from simulator.scenario_player import ScenarioPlayer
from simulator.simulation import Simulation

BAR = 100


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--passes", type=int, default=7)
    arguments = parser.parse_args()
    player = ScenarioPlayer(find_scenario(DEFAULT_SCENARIO))
    simulation = player.simulation
    assert isinstance(simulation, Simulation)
    simulation.run_until(1.0)
    simulation.receive(b"x")
    simulation.run_until(10.0)
    ratios = []
    for _ in range(arguments.passes):
        bytes_before, begin_s = simulation.line.bytes_sent, time.process_time()
        simulation.run_until(simulation.now_s + arguments.seconds)
        ratios.append(arguments.seconds / (time.process_time() - begin_s))
    rate = (simulation.line.bytes_sent - bytes_before) / arguments.seconds
    print(f"virtual master: {max(ratios):.0f} x real time best, {statistics.median(ratios):.0f} median (bar {BAR})")
    print(f"one core in real time: {100 / statistics.median(ratios):.1f} %; line {rate:.0f} bytes/s")


if __name__ == "__main__":
    main()
