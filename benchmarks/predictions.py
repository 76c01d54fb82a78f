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
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.prediction_races import RaceRun, fly_ahead
from benchmarks.voltage_ahead import drive_scores, print_drives

DATA = Path("../shared/data")
SEED, EVERY_S = 31, 60.0
HEADER = (
    f"{'prediction':34} {'n':>5} {'in band %':>9} {'below':>6} {'above':>6} {'median off %':>12} {'bias %':>7} "
    f"{'band +- %':>9}"
)


@dataclass
class Score:
    """What was foretold and what came, pair by pair; an endless one counts as the longest that is looked at."""

    low: list[float] = field(default_factory=list)
    middle: list[float] = field(default_factory=list)
    high: list[float] = field(default_factory=list)
    truth: list[float] = field(default_factory=list)

    def add(self, low: float, middle: float, high: float, truth: float) -> None:
        """Take one prediction and its truth."""
        for values, value in zip(
            (self.low, self.middle, self.high, self.truth), (low, middle, high, truth), strict=True
        ):
            values.append(value)

    def coverage(self) -> float:
        """Share of the truths that lay within their band."""
        low, high, truth = (np.array(values) for values in (self.low, self.high, self.truth))
        return float(((truth >= low) & (truth <= high)).mean())

    def line(self, name: str) -> str:
        """Return a line of the table."""
        low, middle, high, truth = (np.array(v) for v in (self.low, self.middle, self.high, self.truth))
        scale = np.maximum(np.abs(truth), 1e-9)
        off = (middle - truth) / scale
        return (
            f"{name:34} {truth.size:5d} {100 * self.coverage():9.0f} {100 * (truth < low).mean():6.0f} "
            f"{100 * (truth > high).mean():6.0f} {100 * np.median(np.abs(off)):12.1f} {100 * np.median(off):7.1f} "
            f"{100 * np.median((high - low) / 2 / scale):9.1f}"
        )


def score_race(run: RaceRun, scores: dict[str, Score]) -> None:
    """Add the probes of a race."""
    for probe in run.probes:
        for name, low, middle, high, truth in fly_ahead(run, probe):
            scores[name].add(low, middle, high, truth)


def race_scores(scenario: str, seeds: Iterable[int], every_s: float, seconds: float = 1e9) -> dict[str, Score]:
    """Return the scores of some races by prediction."""
    scores: dict[str, Score] = defaultdict(Score)
    for seed in seeds:
        score_race(RaceRun(scenario, seed, every_s, seconds), scores)
    return scores


def run() -> Iterator[tuple[str, str, str]]:
    """Yield what, figure and method for `voltwall bench --predictions`: one race, and the drives where they are."""
    method = f"clean-endurance, seed {SEED}, a moment each {EVERY_S:g} s; truth: the simulator's physics from there"
    for name, score in sorted(race_scores("clean-endurance", [SEED], EVERY_S).items()):
        yield f"prediction: {name}", f"{100 * score.coverage():.0f} % in band", method
    for name, (_, inside, median_v, _, _) in drive_scores(DATA) if DATA.is_dir() else ():
        figure = f"{100 * inside:.0f} % in band"
        yield f"voltage 10 s ahead: {name}", figure, f"the current that flowed; median off {1e3 * median_v:.1f} mV"


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
