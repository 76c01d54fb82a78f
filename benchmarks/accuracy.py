"""How right the filters are on cells that were not tuned on: `python -m benchmarks.accuracy [--data ../shared/data]`.

Every cell is identified from some recordings and judged on others, with the sensor errors of a car: 1.2 mV and 0.1 mV
steps; 0.02C of noise, gain +-0.5 %, offset +-0.0067C, all four signs. Tuning looked at the runs marked "training" only.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.estimation.cell_model.circuit import CellModel
from app.estimation.identification.identify import identify
from app.estimation.recording.cell_recording import Recording
from app.sources.recordings.dataset import load_recording
from tests.numeric.judgement import Judgement, judge, part

FloatArray = NDArray[np.float64]

DATA = Path("../shared/data")
MIDDLES = (0.2, 0.35, 0.5)  # starts under load, as shares of the run
WRONG_SOC = 0.5
WRONG_SOC_MIDDLE = 0.45
LITTLE_OFF = 0.02
SUMMARY_HEADER = """| run | count | CDKF | fused | worse by | 50 points wrong | largest after 60 s | 2 low / high |
| --- | --- | --- | --- | --- | --- | --- | --- |"""
STARTS = {"right": 0.0, "50 off": -WRONG_SOC, "2 low": -LITTLE_OFF, "2 high": LITTLE_OFF}
N_PINNED = 2  # pinned starts for which the fusion is to be as good as the better of its parts


@dataclass(frozen=True)
class Case:
    """The recordings of a cell: those to identify it from, and those to judge it on."""

    name: str
    is_training: bool
    slow: Sequence[Recording]
    pulses: Sequence[Recording]
    drives: Sequence[Recording]
    runs: Sequence[Recording]


def shared_cases(data: Path) -> Iterator[Case]:
    """Yield the cases of the shared data."""
    folder = data / "panasonic-18650pf"
    if folder.is_dir():
        names = ("c20_ocv", "hppc5pulse", "cycle1", "us06")
        slow, pulses, cycle, us06 = (load_recording(folder / f"{name}_25degC.csv.gz") for name in names)
        yield Case("Panasonic, pulses only", True, [slow], [pulses], [], [cycle])
        yield Case("Panasonic", False, [slow], [pulses], [cycle], [us06])
    folder = data / "physics"
    for cell in ("Mohtat2020", "Chen2020") if folder.is_dir() else ():
        slow, pulses, warm, train = (
            load_recording(folder / f"{cell}_{name}.csv.gz") for name in ("c30", "hppc", "hppc40", "train")
        )
        yield Case(f"{cell}, pulses only", True, [slow], [pulses, warm], [], [train])
        half = [part(train, 0.0, 900.0)]
        yield Case(f"{cell}, first half", True, [slow], [pulses, warm], half, [part(train, 880.0, 1e9)])


def too_wide(family: Sequence[Judgement]) -> float:
    """Return RMS sigma over RMS error of a run from all its starts and signs of the sensors: 1 is honest.

    A family, because one start that happens to be right proves no sigma too wide.
    """
    scores = [score for judged in family for score in judged.scores]
    squares = np.array([(score.sigma_rms**2, score.soc_rmse**2) for score in scores])
    return float(np.sqrt(squares[:, 0].mean() / squares[:, 1].mean()))


HEADER = (
    f"{'run':44} {'start':10} {'count':>9} {'filter':>9} {'fused':>9} {'excess':>6} {'5 % / 2 % after':>16} "
    f"{'max>60s':>7} {'in 3 s':>6} {'NEES':>5} {'NIS':>5} {'white':>5} {'lasts':>6}"
)


def line(what: str, start: str, found: Judgement) -> str:
    """Return a line of the table: medians / worst over the signs, the worst where there is one figure."""

    def pair(values: FloatArray) -> str:
        return f"{np.median(values):.2f}/{values.max():.2f}"

    def slowest(values: list[float | None]) -> str:
        known = [value for value in values if value is not None]
        return f"{max(known):.0f}" if len(known) == len(values) else "never"

    lasting = [score for score in found.innovations if score is not None]
    settled = f"{slowest([s.settle_5_s for s in found.scores])} / {slowest([s.settle_2_s for s in found.scores])} s"
    return (
        f"{what:44} {start:10} {pair(found.count):>9} {pair(found.filter):>9} {pair(found.fused):>9} "
        f"{found.excess.max():6.2f} {settled:>16} {100 * max(s.soc_max_error_after_60s for s in found.scores):7.2f} "
        f"{min(s.inside_3_sigma for s in found.scores):6.3f} {np.mean([s.nees for s in found.scores]):5.2f} "
        f"{np.mean([s.nis for s in lasting]):5.2f} {np.mean([s.innovation_white_share for s in lasting]):5.2f} "
        f"{np.mean([s.innovation_correlation_s for s in lasting]):5.1f}s"
    )


def print_summary(found: Mapping[str, Sequence[Judgement]]) -> None:
    """Print a row of Markdown a run, in points of SOC: median / worst over the signs of the sensor errors."""
    print(SUMMARY_HEADER)
    for label, (right, wrong, low, high) in found.items():
        columns = [f"{np.median(each):.2f} / {each.max():.2f}" for each in (right.count, right.filter, right.fused)]
        largest = 100.0 * max(score.soc_max_error_after_60s for score in wrong.scores)
        columns += [f"{right.excess.max():.2f}", f"{np.median(wrong.fused):.2f} / {wrong.fused.max():.2f}"]
        columns += [f"{largest:.1f}", f"{np.median(low.fused):.2f} / {np.median(high.fused):.2f}"]
        print(f"| {' | '.join((label, *columns))} |")


def judge_case(case: Case, middles: Sequence[float] = MIDDLES) -> dict[str, tuple[CellModel, list[Judgement]]]:
    """Identify a cell, print a line a run and start, and return the judgements of its whole runs by run."""
    model = identify(case.slow, case.pulses, case.drives, 2, case.name).model
    found = {}
    for run in case.runs:
        label = f"{case.name}: {run.source.removesuffix('.gz').removesuffix('.csv')}"
        label += " (training)" if case.is_training else ""
        whole = [judge(model, run, off) for off in STARTS.values()]
        for start, judged in zip(STARTS, whole, strict=True):
            print(line(label[-44:], start, judged), flush=True)
        family = list(whole)
        lasted_s = float(run.time_s[-1] - run.time_s[0])
        for share in middles:
            rest = part(run, share * lasted_s, max(share * lasted_s + 600.0, (share + 0.45) * lasted_s))
            family.append(judge(model, rest, -WRONG_SOC_MIDDLE))
            print(line(label[-44:], f"45 at {share:.0%}", family[-1]), flush=True)
        print(f"{label[-44:]:44} all starts: sigma {too_wide(family):.2f} times the error", flush=True)
        found[run.source] = model, whole
    return found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=DATA, help="folder with panasonic-18650pf/ and physics/")
    args = parser.parse_args()
    print(HEADER)
    found = {
        f"{case.name}: {run}": whole for case in shared_cases(args.data) for run, (_, whole) in judge_case(case).items()
    }
    if not found:
        print(f"skipped: nothing in {args.data}")
        return
    print_summary(found)
    excess = [judged.excess for whole in found.values() for judged in whole[:N_PINNED]]
    print(f"whole runs: the fusion is worse than the better of its parts by {np.max(excess):.2f} points at most")


if __name__ == "__main__":
    main()
