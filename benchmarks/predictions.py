"""How often the truth fell into the band of a prediction, and how far off its median was.

    python -m benchmarks.predictions [--races 4] [--seed 31] [--every 60] [--data ../shared/data]

Simulated races go through the real path in process, at full speed: the virtual car's frames, decoder, pipeline,
estimator, predictor. At moments of the race the prediction is compared with what the simulator's own physics does from
its true state, which shares no code with the filter's model:

- power: the largest constant current that the physics holds for so long without a cell passing a limit, and the power
  that this gives throughout;
- seconds to a limit: the constant current that the prediction names, until a cell passes it;
- energy and laps left: the current that the race then really takes, its laps repeated after the end, until the first
  cell is empty.

Measured and PyBaMM drives have no such truth. There the voltage 10 s ahead is predicted, under the current that then
really flowed. The bands were tuned on the runs marked "training" only: races with the seeds 101 to 103, Cycle 1, Chen.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from tests.numeric.prediction_score import HEADER, Score, race_scores
from tests.numeric.voltage_ahead import print_drives

DATA = Path("../shared/data")
SEED, EVERY_S = 31, 60.0


def print_scores(title: str, scores: dict[str, Score]) -> None:
    """Print a table."""
    print(f"\n{title}\n{HEADER}")
    for name in sorted(scores):
        print(scores[name].line(name))


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--races", type=int, default=4)
    parser.add_argument("--seed", type=int, default=SEED, help="of the first race")
    parser.add_argument("--every", type=float, default=EVERY_S, help="seconds between two moments that are judged")
    parser.add_argument("--scenario", action="append", help="default: clean-endurance, then hot-endurance")
    parser.add_argument("--data", type=Path, default=DATA, help="folder with panasonic-18650pf/ and physics/")
    args = parser.parse_args()
    for scenario in args.scenario or ("clean-endurance", "hot-endurance"):
        seeds = range(args.seed, args.seed + args.races)
        print_scores(f"{scenario}, seeds {seeds[0]} to {seeds[-1]}", race_scores(scenario, seeds, args.every))
    if args.data.is_dir():
        print_drives(args.data)
    else:
        print(f"skipped: nothing in {args.data}")


if __name__ == "__main__":
    main()
