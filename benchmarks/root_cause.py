"""Share of trips whose cause is named right: `python -m benchmarks.root_cause [--part faults] [--write]`.

    faults    every fault of the simulator and three abuses of a sound car, at random cells, times and sizes
    joints    20 joints of 11 to 20 mohm, a minute into the race
    sizes     40 joints of any size at any time: whether the band on the cell's page holds the truth
    healthy   20 half-hours of a sound car's time: nothing may be blamed
    services  10 faults in running services, each a process with its simulated car, a few at a time

Each car is received by the service itself (`tests.recorded.service_car`), as fast as it goes, or by its process in real
time. *Live* is the verdict that it makes at the trip, without one its alarm; *recorded* that of the session's file
alone, judged again. A cause is right when its code, or one that stands for several that a recording cannot
distinguish, is that of the fault, at its cell or pack. *Agree*: banner, cell, black box, report and the command line
show one code, place and size of each trip.

Thresholds are chosen on seeds 0 to 99; what is reported begins at seed FIRST. Runs of earlier calls with the same
`--folder` are not played again, and those of parts that are not asked for are reported too. With `--write` the figures
are put into docs/reference/causes.md.
"""

from __future__ import annotations

import argparse
import logging
import re
import tempfile
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Final

from benchmarks.root_cause_runs import Drawn, any_joint, faults, half_hour, large_joint
from benchmarks.root_cause_services import N_SERVICES, play_services, served
from benchmarks.root_cause_shown import Run, kept_run, play

FIRST: Final = 20261128
SEEDS, N_JOINTS, N_SIZES, N_HEALTHY = 5, 20, 40, 20
PAGE: Final = Path(__file__).parents[1] / "docs/reference/causes.md"
BEGIN, END = "<!-- figures -->", "<!-- end of figures -->"
PARTS: Final = ("faults", "joints", "sizes", "healthy", "services")


def drawn(part: str, first: int, seeds: int) -> list[Drawn]:
    """Return the runs of a part; `seeds` is of the faults, and scales the other parts alike."""

    def some(make: Callable[[int], Drawn], n: int) -> list[Drawn]:
        return [make(first + k) for k in range(max(n * seeds // SEEDS, 1))]

    match part:
        case "faults":
            return [fault for k in range(seeds) for fault in faults(first + k)]
        case "joints":
            return some(large_joint, N_JOINTS)
        case "sizes":
            return some(any_joint, N_SIZES)
        case "healthy":
            return some(half_hour, N_HEALTHY)
    return served(first, max(N_SERVICES * seeds // SEEDS, 1))


def kept(part: str, first: int, folder: Path) -> list[Run]:
    """Return the runs of a part that were played before."""
    runs = (kept_run(folder / case.name) for case, _ in drawn(part, first, SEEDS))
    return [run for run in runs if run is not None]


def matrix(runs: Sequence[Run]) -> str:
    """Return the confusion matrix of faults as Markdown: what was named, only what occurred."""
    rows: dict[str, list[Run]] = defaultdict(list)
    for run in runs:
        rows[run.case.fault].append(run)
    lines = ["| Fault | Runs | Recorded | Live | Agree | Named live |", "| --- | --- | --- | --- | --- | --- |"]
    for fault, of in rows.items():
        shown = Counter(_shown(run) for run in of)
        named = ", ".join(f"{code} {n}" for code, n in shown.most_common())
        right = sum(run.is_right_recorded for run in of), sum(run.is_right_live for run in of)
        lines.append(f"| {fault} | {len(of)} | {right[0]} | {right[1]} | {_agreement(of)} | {named} |")
    return "\n".join(lines)


def _shown(run: Run) -> str:
    """What a run's live column counts: its verdict, without a trip the alarm that names it."""
    if run.live is not None:
        return run.live.code
    return f"alarm {run.case.fault}" if run.is_right_live else "no alarm of it"


def _agreement(runs: Iterable[Run]) -> str:
    tripped = [run for run in runs if run.apart is not None]
    return f"{sum(not run.apart for run in tripped)} of {len(tripped)}" if tripped else "no trip"


def summary(runs: dict[str, list[Run]]) -> str:
    """Return the figures against what is wanted of them."""
    lines = ["| Figure | Wanted | Found |", "| --- | --- | --- |"]

    def add(what: str, wanted: str, part: str, right: Callable[[Run], bool]) -> None:
        hits = [right(run) for run in runs.get(part, [])]
        if hits:
            lines.append(f"| {what} | {wanted} | {sum(hits)} of {len(hits)} ({sum(hits) / len(hits):.1%}) |")

    add("cause of a fault, recorded", "95 %", "faults", lambda run: run.is_right_recorded)
    add("cause of a fault, live", "95 %", "faults", lambda run: run.is_right_live)
    add("cause in a running service", "9 of 10", "services", lambda run: run.is_right_live)
    add("joint of 11 to 20 mohm, recorded", "18 of 20", "joints", lambda run: run.is_right_recorded)
    add("joint of 11 to 20 mohm, live", "18 of 20", "joints", lambda run: run.is_right_live)
    add("band of a joint holds its size", "90 %", "sizes", lambda run: bool(run.has_band))
    nothing = "half-hour of a sound car, nothing blamed"
    add(nothing, "all", "healthy", lambda run: run.is_right_recorded and run.is_right_live)
    every = [run for of in runs.values() for run in of]
    lines.append(f"| all places agree on a trip | 100 % | {_agreement(every)} |")
    return "\n".join(lines)


def misses(runs: Iterable[Run]) -> str:
    """Return a line for each run that was not right everywhere."""
    lines = []
    for run in runs:
        case, wrong = run.case, []
        if not run.is_right_recorded:
            wrong.append("recorded " + (", ".join(cause.place for cause in run.recorded[:3]) or "nothing"))
        if not run.is_right_live:
            alarms = ", ".join(dict.fromkeys(alarm.place for alarm in run.alarms)) or "nothing"
            wrong.append(f"live {alarms if run.live is None else run.live.place}")
        if run.apart:
            wrong.append(f"apart: {', '.join(run.apart)}")
        if case.part == "sizes" and not run.has_band:
            page = run.page
            wrong.append("no size" if page is None else f"{_mohm(page.low)} to {_mohm(page.high)} mohm")
        if wrong:
            size = "" if case.value is None else f", {case.value:.3g}"
            where = "" if case.where is None else f" at {case.where}"
            lines.append(f"- {case.name}{where}{size}: {'; '.join(wrong)}")
    return "\n".join(lines) or "- none"


def _mohm(ohm: float | None) -> str:
    return "?" if ohm is None else f"{1000 * ohm:.2f}"


def text(runs: dict[str, list[Run]], first: int) -> str:
    """Return everything as Markdown."""
    every = [run for part in PARTS for run in runs.get(part, [])]
    played = ", ".join(f"{part} {len(runs.get(part, []))} of {len(drawn(part, first, SEEDS))}" for part in PARTS)
    parts = [f"Seeds from {first}. Played: {played}.", summary(runs)]
    if runs.get("faults"):
        parts.append(matrix(runs["faults"]))
    return "\n\n".join([*parts, "Not right, or not alike everywhere (cells count from 0):", misses(every)])


def main() -> None:
    """Play, judge, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--part", choices=PARTS, action="append", help="only this; may be given again")
    parser.add_argument("--first", type=int, default=FIRST, help="first seed (default: %(default)s)")
    parser.add_argument("--seeds", type=int, default=SEEDS, help="of each fault; fewer shorten every part alike")
    parser.add_argument("--jobs", type=int, default=2, help="cars at a time")
    parser.add_argument("--folder", type=Path, help="where runs are kept and found again; else they are thrown away")
    parser.add_argument("--write", action="store_true", help=f"put the figures into {PAGE.name}")
    arguments = parser.parse_args()
    logging.getLogger("app").setLevel(logging.ERROR)
    runs: dict[str, list[Run]] = {}
    with tempfile.TemporaryDirectory() as scratch:
        folder = arguments.folder or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        for part in PARTS:
            if part not in (arguments.part or PARTS):
                runs[part] = kept(part, arguments.first, folder)
                continue
            chosen = drawn(part, arguments.first, arguments.seeds)
            if part == "services":
                runs[part] = play_services(chosen, folder, 2 * arguments.jobs)
                continue
            with ProcessPoolExecutor(arguments.jobs) as pool:
                runs[part] = list(pool.map(partial(play, folder=folder), chosen))
    figures = text(runs, arguments.first)
    print(figures)
    if arguments.write:
        page = PAGE.read_text(encoding="utf-8")
        block = f"{BEGIN}\n{figures}\n{END}"
        PAGE.write_text(re.sub(f"{BEGIN}.*{END}", lambda _: block, page, flags=re.DOTALL), encoding="utf-8")


if __name__ == "__main__":
    main()
