"""Runs what takes long: many examples, kills, power cuts, noise, a day of racing, every route, pages for minutes.

`make campaign` runs all of it within half an hour, `make campaign SHORT=1` in minutes what `make test` leaves out or
barely samples, `make campaign LONG=1` the hours: two of them at full use, a day in accelerated time, ten minutes a
target of fuzzing. The full and the long one write a row for each file of tests into docs/contributing/reliability.md;
`ONLY=soak` runs the part of that name and leaves the other rows as they were. Each prints what it found in one line.
The tests are those of `make test` in a larger size (`tests/campaign.py`); the pages are measured by
`benchmarks/pages.py`.
"""

from __future__ import annotations

import argparse
import ast
import os
import re
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from xml.etree import ElementTree

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "contributing" / "reliability.md"
BEGIN, END = "<!-- campaign -->", "<!-- end of campaign -->"
COLUMNS = ("Promise", "Test", "Size", "Day", "Took", "Count", "Result")
NOTHING = "pytest"  # the command of a part without a row
RULE = "| --- | --- | --- | --- | ---: | ---: | --- |"
SIZES = ("short", "full", "long")
PROPERTIES = ("-m", "hypothesis", "tests/unit", "tests/property", "tests/numeric")
ANYTHING = "Whatever hypothesis thinks of: every property of the code, with many examples"
TESTS = (
    "tests/integration/test_openapi.py",
    "tests/integration/test_generated_client.py",
    "tests/integration/test_typescript_client.py",
    "tests/property/test_fuzz.py",
    "tests/integration/test_config_power_cut.py",
    "tests/integration/test_weak_joint.py",
    "tests/integration/test_sessions_campaign.py::test_a_kill_at_any_instant_loses_nothing_that_was_acknowledged",
    "tests/integration/test_sessions_campaign.py::test_a_power_cut_at_any_instant_loses_nothing_that_was_acknowledged",
    "tests/integration/test_disk_faults.py",
    "tests/integration/test_stalled_disk.py",
    "tests/integration/test_sessions_survive.py::test_a_killed_recorder_loses_at_most_the_last_half_second",
    "tests/integration/test_season_campaign.py",
    "tests/integration/test_season_s3.py",
    "tests/integration/test_bad_radio.py",
    "tests/integration/test_connection_flood.py",
    "tests/integration/test_silent_handshakes.py",
    "tests/integration/test_stop_at_once.py",
    "tests/packaging/test_engine_build.py",
    "tests/packaging/test_wheel.py",
)
ALONE = ("tests/integration/test_recorder_starved.py",)  # its share of a core is what nothing else takes
PROCESSES = {"short": 3, "full": 3, "long": 2}  # at once: many wait for a car, a service or a page
FULL_ONLY = (  # the short campaign would repeat `make test`
    "tests/unit/app/analysis/evidence/test_timing.py",
    "tests/numeric/test_joints_race.py",
    "tests/numeric/test_prediction_coverage.py",
    "tests/numeric/test_energy_target_race.py",
    "tests/property/test_expressions.py",
    "tests/integration/test_hostile_definitions.py",
    "tests/property/test_filters_definite.py",
    "tests/numeric/test_filters_calibration.py",
    "tests/integration/test_simulator_scenarios.py",
    "tests/integration/test_simulator_charging.py",
    "tests/integration/test_day_race.py",
    "tests/integration/test_simulator_c_codec.py",
    "tests/e2e/test_still.py",
    "tests/integration/test_soak.py",
    "tests/integration/test_hurried_day.py",
    "tests/packaging/test_site.py",
    "tests/unit/app/sources/dbc/test_hostile_bus.py",
    "tests/unit/app/sources/serial/test_thesis_streams.py",
    "tests/unit/app/sessions/transfer/test_broken_logs.py",
    "tests/unit/app/sessions/transfer/test_follow.py",
    "tests/unit/app/sessions/reading/test_check.py::test_no_damaged_copy_is_called_sound_although_its_content_differs",
    "tests/e2e/test_pages.py",
    "tests/e2e/test_debrief.py",
    "tests/e2e/test_first_steps.py",
    "tests/e2e/test_pictures.py",
)
PAGES = "benchmarks/pages.py"
PAGE_MINUTES = {"full": 2.0, "long": 60.0}
PAGE_HOURS = {"full": 1.0, "long": 4.0}
HEAP_GROWTH_MB = 8.0  # more than a garbage collection leaves behind by chance


@dataclass(frozen=True)
class Part:
    """A row of the table: what is promised, by which test, how often it was tried, and what came out."""

    promise: str
    test: str
    count: int
    result: str
    held: bool
    took_s: float = 0.0  # sum over its tests; several run at once


def run_tests(size: str, what: str, *chosen: str, promise: str | None = None) -> list[Part]:
    """Run tests in a size, print their figures and how many there were; return a part for each file, or one for all."""
    with tempfile.TemporaryDirectory() as folder:
        figures, cases = Path(folder) / "figures", Path(folder) / "cases.xml"
        figures.touch()
        environment = os.environ | {"VOLTWALL_CAMPAIGN": size, "VOLTWALL_FIGURES": str(figures)}
        command = [sys.executable, "-m", "pytest", "-q", "-n", str(PROCESSES[size]), "--dist", "worksteal"]
        command += ["-o", "junit_family=xunit1", f"--junitxml={cases}", *chosen]
        done = subprocess.run(command, cwd=ROOT, env=environment, check=False, capture_output=True, text=True)
        measured = sorted(line.split("\t", 1) for line in figures.read_text(encoding="utf-8").splitlines())
        testcases = [*ElementTree.parse(cases).getroot().iter("testcase")] if cases.exists() else []
        counted = Counter((case.get("file") or "?", _outcome(case)) for case in testcases)
        took_s = Counter[str]()
        for case in testcases:
            took_s[case.get("file") or "?"] += float(case.get("time") or 0.0)  # type: ignore[assignment]
    print(*(figure for _, figure in measured), sep="\n")
    print(f"{what}: {(done.stdout.splitlines() or ['nothing'])[-1]}", flush=True)
    if done.returncode:
        print(done.stdout, done.stderr, sep="\n", file=sys.stderr)
    if done.returncode and not any(outcome == "failed" for _, outcome in counted):
        return [Part(what, NOTHING, 0, "DID NOT RUN", held=False)]
    if promise is not None:
        return [replace(_part(promise, " ".join(chosen), counted, measured), took_s=sum(took_s.values()))]
    files = sorted({file for file, _ in counted})
    return [replace(_part(promise_of(file), file, counted, measured), took_s=took_s[file]) for file in files]


def _part(promise: str, file: str, counted: Counter[tuple[str, str]], measured: list[list[str]]) -> Part:
    """The row of a file of tests, or of all."""
    of_all = not file.endswith(".py")
    passed, failed, skipped = (
        sum(n for (its, outcome), n in counted.items() if outcome == wanted and (of_all or its == file))
        for wanted in ("passed", "failed", "skipped")
    )
    words = [f"{failed} FAILED"] * bool(failed) + [f"{skipped} skipped"] * bool(skipped)
    words += [figure.replace("|", "/") for test, figure in measured if of_all or test.startswith(file)]
    return Part(promise, file, passed + failed, "; ".join(words) or "held", held=not failed)


def _outcome(case: ElementTree.Element) -> str:
    if case.find("failure") is not None or case.find("error") is not None:
        return "failed"
    return "passed" if case.find("skipped") is None else "skipped"


def promise_of(file: str) -> str:
    """The first sentence of a file of tests."""
    docstring = ast.get_docstring(ast.parse((ROOT / file).read_text(encoding="utf-8"))) or file
    return " ".join(docstring.split("\n\n")[0].split()).rstrip(".")


def as_rows(size: str, day: str, parts: list[Part]) -> list[str]:
    """Return a row for each part: promise / test / size / day / took / count / result."""
    return [
        f"| {part.promise} | `{part.test}` | {size} | {day} | {part.took_s:.0f} s | {part.count} | {part.result} |"
        for part in parts
    ]


def write_table(page: Path, size: str, day: str, parts: list[Part]) -> None:
    """Put the rows between the marks of a page, in place of those of the same test and size; others stay."""
    head, _, rest = page.read_text(encoding="utf-8").partition(BEGIN)
    before, _, tail = rest.partition(END)
    rows = {_key(row): row for row in before.splitlines() if row.count("|") > len(COLUMNS) and "`" in row}
    rows |= {_key(row): row for row in as_rows(size, day, [part for part in parts if part.test != NOTHING])}
    table = "\n".join([f"| {' | '.join(COLUMNS)} |", RULE, *(rows[key] for key in sorted(rows))])
    page.write_text(f"{head}{BEGIN}\n{table}\n{END}{tail}", encoding="utf-8")


def _key(row: str) -> tuple[int, str]:
    """Of a row: its size, then its test."""
    _, _, test, size, *_ = (cell.strip() for cell in row.split("|"))
    return SIZES.index(size), test


def run_pages(size: str) -> Part:
    """Leave a page open under the live stream and move through a long session; return how it held."""
    promise = "A page that stays open under the live stream, and scrubs through a long session, keeps its memory"
    command = [sys.executable, "-m", "benchmarks.pages", "--minutes", str(PAGE_MINUTES[size])]
    command += ["--hours", str(PAGE_HOURS[size])]
    began_s = time.monotonic()
    done = subprocess.run(command, cwd=ROOT, check=False, capture_output=True, text=True)
    took_s = time.monotonic() - began_s
    heap = re.search(r"heap after warm-up.*?([+-]\d+\.\d+) MB", done.stdout)
    if done.returncode or heap is None or "LOST" in done.stdout or float(heap[1]) > HEAP_GROWTH_MB:
        print(done.stdout, done.stderr, sep="\n", file=sys.stderr)
        return Part(promise, PAGES, 1, "1 FAILED", held=False, took_s=took_s)
    scrubbed = re.search(r"scrubbed: (.*)", done.stdout)
    moves = "" if scrubbed is None else f"; a session of {PAGE_HOURS[size]:g} h scrubbed, {scrubbed[1]}"
    result = f"{PAGE_MINUTES[size]:g} min of the live stream, heap {heap[1]} MB{moves}"
    print(f"pages: {result}", flush=True)
    return Part(promise, PAGES, 1, result, held=True, took_s=took_s)


def run_chosen(size: str, only: str) -> list[Part]:
    """Run all parts, or those whose name has a word in it."""
    chosen = [test for test in (TESTS if size == "short" else (*TESTS, *FULL_ONLY)) if only in test]
    alone = [test for test in ALONE if only in test]
    parts = run_tests(size, "long", *chosen) if chosen else []
    parts += run_tests(size, "alone", *alone) if alone else []
    if size == "short":
        return parts
    parts += run_tests(size, "properties", *PROPERTIES, promise=ANYTHING) if only in "properties" else []
    return [*parts, run_pages(size)] if only in PAGES else parts


def main() -> int:
    """Run, tell how long it took, and keep the rows of the full and the long size."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", dest="size", action="store_const", const="short", default="full", help="minutes")
    parser.add_argument("--long", dest="size", action="store_const", const="long", help="hours")
    parser.add_argument("--only", metavar="WORD", default="", help="tests with the word in their path, or `properties`")
    parser.add_argument("--table", type=Path, metavar="FILE", help=f"the page with the rows ({PAGE.name}; short: none)")
    options = parser.parse_args()
    began_s = time.monotonic()
    parts = run_chosen(options.size, options.only)
    if not parts:
        parser.error(f"no part of the campaign is called {options.only}")
    took_s = time.monotonic() - began_s
    has_held = all(part.held for part in parts)
    for part in parts:
        if not part.held:
            print(f"{part.test}: {part.result}")
    if not options.only:
        result = "held" if has_held else "FAILED"
        parts.append(Part("All of it", ".ci/campaign.py", sum(part.count for part in parts), result, has_held, took_s))
    page = options.table or (None if options.size == "short" else PAGE)
    if page is not None:
        write_table(page, options.size, f"{datetime.now(UTC):%Y-%m-%d}", parts)
    print(f"campaign ({options.size}): {'held' if has_held else 'FAILED'}, {took_s / 60:.1f} min")
    return 0 if has_held else 1


if __name__ == "__main__":
    sys.exit(main())
