"""How often the cause of a trip is named right: `python -m benchmarks.root_cause [--seeds 5] [--first 100]`.

Every fault of the simulator, three abuses of a sound car and five healthy runs, each with cell, time and magnitude at
random and each recorded by the service's own decoder, pipeline and recorder (`benchmarks.root_cause_runs`). The judge
sees the session file only. Printed as Markdown: a row a fault with what was named, the shares, and each miss.

A fault counts as named when the first cause is the right code at the right cell or pack. A code that stands for several
things that a recording cannot tell apart counts where it contains the right one. Seeds 0 to 4 took part in making the
hypotheses; 100 and up did not.
"""

from __future__ import annotations

import argparse
import tempfile
import warnings
from collections import Counter, defaultdict
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from app.analysis.root_cause.from_session import causes_of
from app.analysis.root_cause.judge import SAME, Cause
from app.live.pipeline_factory import PipelineFactory
from app.sessions.reading.reader import SessionFile
from benchmarks.root_cause_runs import HEALTHY, Case, cases, record

CELL: Final = "samsung-25r-10p"


@dataclass(frozen=True)
class Verdict:
    """What was named of one run."""

    case: Case
    causes: list[Cause]

    @property
    def named(self) -> str:
        """The first cause."""
        return self.causes[0].code if self.causes else "nothing"

    @property
    def is_right(self) -> bool:
        """The first cause is the right one at the right place; of a healthy run: there is none."""
        if self.case.fault in HEALTHY:
            return not self.causes
        if self.named != self.case.fault and self.case.fault not in SAME.get(self.named, ()):
            return False
        main, case = self.causes[0], self.case
        if case.cell is not None:
            return main.cell == case.cell
        return case.pack is None or main.pack == case.pack

    @property
    def is_exonerated(self) -> bool:
        """A cell is at fault and no cause, first or not, names it."""
        if self.case.cell is None:
            return False
        named = {cause.cell for cause in self.causes} | {o.cell for cause in self.causes for o in cause.others}
        return self.case.cell not in named


def judge(case: Case, folder: Path) -> Verdict:
    """Record a run where that was not done, and ask what was wrong."""
    path = record(case, folder, PipelineFactory("fused", CELL))
    with warnings.catch_warnings(), SessionFile(path) as session:
        warnings.simplefilter("ignore")
        return Verdict(case, causes_of(session))


def table(verdicts: list[Verdict]) -> str:
    """Return the confusion matrix as Markdown: only what occurred."""
    rows: dict[str, Counter[str]] = defaultdict(Counter)
    right: Counter[str] = Counter()
    for each in verdicts:
        rows[each.case.fault][each.named] += 1
        right[each.case.fault] += each.is_right
    lines = ["| fault | runs | right | named |", "| --- | --- | --- | --- |"]
    for fault, named in rows.items():
        told = ", ".join(f"{code} {n}" for code, n in named.most_common())
        lines.append(f"| {fault} | {named.total()} | {right[fault]} | {told} |")
    return "\n".join(lines)


def summary(verdicts: list[Verdict]) -> str:
    """Return the shares, and each miss."""
    faulty = [each for each in verdicts if each.case.fault not in HEALTHY]
    healthy = [each for each in verdicts if each.case.fault in HEALTHY]
    n_right = sum(each.is_right for each in faulty)
    lines = [
        f"named right: {n_right} of {len(faulty)} ({100 * n_right / max(len(faulty), 1):.1f} %)",
        f"cells at fault that no cause names: {sum(each.is_exonerated for each in faulty)}",
        f"healthy runs with a cause: {sum(not each.is_right for each in healthy)} of {len(healthy)}",
    ]
    for each in verdicts:
        if not each.is_right:
            case, named = each.case, [f"{c.code}@{c.cell if c.cell is not None else c.pack}" for c in each.causes]
            place = case.cell if case.cell is not None else case.pack
            lines.append(f"miss: {case.name} ({place}, {case.value}): {', '.join(named) or 'nothing'}")
    return "\n".join(lines)


def main() -> None:
    """Record, judge, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=100, help="first seed")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--folder", type=Path, help="where the sessions are kept; else they are thrown away")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = arguments.folder or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        drawn = [case for seed in range(arguments.first, arguments.first + arguments.seeds) for case in cases(seed)]
        with ProcessPoolExecutor(arguments.jobs) as pool:
            verdicts = list(pool.map(partial(judge, folder=folder), drawn))
    print(table(verdicts))
    print()
    print(summary(verdicts))


if __name__ == "__main__":
    main()
