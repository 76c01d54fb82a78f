"""Runs what takes long: many examples, kills, power cuts, noise, a day of racing, every route, pages for minutes.

`make campaign` runs all of it and writes the table promise / test / count / result into docs/reference/reliability.md,
`make campaign SHORT=1` a part of each. Each prints what it found in one line. The tests are those of `make test` in a
larger size (`tests/campaign.py`); the pages are measured by `benchmarks/pages.py`.
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
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from xml.etree import ElementTree

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "reference" / "reliability.md"
BEGIN, END = "<!-- campaign -->", "<!-- end of campaign -->"
PROPERTIES = ("-m", "hypothesis", "tests/unit", "tests/property", "tests/numeric")
ANYTHING = "Whatever hypothesis thinks of: every property of the code, with many examples"
TESTS = (
    "tests/unit/app/analysis/evidence/test_timing.py",
    "tests/numeric/test_joints_race.py",
    "tests/numeric/test_prediction_coverage.py",
    "tests/numeric/test_energy_target_race.py",
    "tests/integration/test_openapi.py",
    "tests/integration/test_generated_client.py",
    "tests/integration/test_typescript_client.py",
    "tests/property/test_fuzz.py",
    "tests/property/test_filters_definite.py",
    "tests/numeric/test_filters_calibration.py",
    "tests/integration/test_simulator_scenarios.py",
    "tests/integration/test_simulator_charging.py",
    "tests/integration/test_config_power_cut.py",
    "tests/integration/test_weak_joint.py",
    "tests/integration/test_day_race.py",
    "tests/integration/test_sessions_campaign.py::test_a_kill_at_any_instant_loses_nothing_that_was_acknowledged",
    "tests/integration/test_sessions_campaign.py::test_a_power_cut_at_any_instant_loses_nothing_that_was_acknowledged",
    "tests/integration/test_disk_faults.py",
    "tests/integration/test_sessions_survive.py::test_a_killed_recorder_loses_at_most_the_last_half_second",
    "tests/integration/test_season_campaign.py",
    "tests/integration/test_season_s3.py",
    "tests/integration/test_bad_radio.py",
    "tests/integration/test_simulator_c_codec.py",
    "tests/integration/test_connection_flood.py",
    "tests/integration/test_stop_at_once.py",
    "tests/e2e/test_still.py",
    "tests/integration/test_soak.py",
    "tests/integration/test_hurried_day.py",
    "tests/packaging/test_wheel.py",
    "tests/packaging/test_site.py",
    "tests/unit/app/sources/dbc/test_hostile_bus.py",
    "tests/unit/app/sessions/transfer/test_broken_logs.py",
    "tests/unit/app/sessions/transfer/test_follow.py",
    "tests/unit/app/sessions/reading/test_check.py::test_no_damaged_copy_is_called_sound_although_its_content_differs",
)
ALONE = ("tests/integration/test_recorder_starved.py",)  # its share of a core is what nothing else takes
PROCESSES = {"short": 3, "full": 2}  # at once: many wait for a car, a service or a page
FULL_ONLY = (
    "tests/e2e/test_pages.py",  # the short campaign would repeat `make test`
    "tests/e2e/test_debrief.py",
    "tests/e2e/test_pictures.py",
)
PAGE_MINUTES = {"short": 0.5, "full": 6.0}
PAGE_HOURS = {"short": 0.5, "full": 4.0}
HEAP_GROWTH_MB = 8.0  # more than a garbage collection leaves behind by chance


@dataclass(frozen=True)
class Part:
    """A row of the table: what is promised, by which test, how often it was tried, and what came out."""

    promise: str
    test: str
    count: int
    result: str
    held: bool


def run_tests(size: str, what: str, *chosen: str, promise: str | None = None) -> list[Part]:
    """Run tests in a size, print their figures and how many there were; return a part for each file, or one for all."""
    with tempfile.TemporaryDirectory() as folder:
        figures, cases = Path(folder) / "figures", Path(folder) / "cases.xml"
        figures.touch()
        environment = os.environ | {"VOLTWALL_CAMPAIGN": size, "VOLTWALL_FIGURES": str(figures)}
        command = [sys.executable, "-m", "pytest", "-q", "-n", str(PROCESSES[size]), "--dist", "worksteal"]
        command += ["-o", "junit_family=xunit1", f"--junitxml={cases}", *chosen]
        done = subprocess.run(command, cwd=ROOT, env=environment, check=False, capture_output=True, text=True)
        told = sorted(line.split("\t", 1) for line in figures.read_text(encoding="utf-8").splitlines())
        found = ElementTree.parse(cases).getroot().iter("testcase") if cases.exists() else ()
        counted = Counter((case.get("file") or "?", _outcome(case)) for case in found)
    print(*(figure for _, figure in told), sep="\n")
    print(f"{what}: {(done.stdout.splitlines() or ['nothing'])[-1]}", flush=True)
    if done.returncode:
        print(done.stdout, done.stderr, sep="\n", file=sys.stderr)
    if done.returncode and not any(outcome == "failed" for _, outcome in counted):
        return [Part(what, "pytest", 0, "DID NOT RUN", held=False)]
    if promise is not None:
        return [_part(promise, " ".join(chosen), counted, told)]
    files = sorted({file for file, _ in counted})
    return [_part(promise_of(file), file, counted, told) for file in files]


def _part(promise: str, file: str, counted: Counter[tuple[str, str]], told: list[list[str]]) -> Part:
    """The row of a file of tests, or of all."""
    of_all = not file.endswith(".py")
    passed, failed, skipped = (
        sum(n for (its, outcome), n in counted.items() if outcome == wanted and (of_all or its == file))
        for wanted in ("passed", "failed", "skipped")
    )
    words = [f"{failed} FAILED"] * bool(failed) + [f"{skipped} skipped"] * bool(skipped)
    words += [figure.replace("|", "/") for test, figure in told if of_all or test.startswith(file)]
    return Part(promise, file, passed + failed, "; ".join(words) or "held", held=not failed)


def _outcome(case: ElementTree.Element) -> str:
    if case.find("failure") is not None or case.find("error") is not None:
        return "failed"
    return "passed" if case.find("skipped") is None else "skipped"


def promise_of(file: str) -> str:
    """The first sentence of a file of tests."""
    told = ast.get_docstring(ast.parse((ROOT / file).read_text(encoding="utf-8"))) or file
    return " ".join(told.split("\n\n")[0].split()).rstrip(".")


def as_table(parts: list[Part]) -> str:
    """Return the table promise / test / count / result."""
    rows = [f"| {each.promise} | `{each.test}` | {each.count} | {each.result} |" for each in parts]
    return "\n".join(["| Promise | Test | Count | Result |", "| --- | --- | ---: | --- |", *rows])


def write_table(page: Path, size: str, minutes: float, parts: list[Part]) -> None:
    """Put the table between the marks of a page."""
    head, _, rest = page.read_text(encoding="utf-8").partition(BEGIN)
    _, _, tail = rest.partition(END)
    when = f"{datetime.now(UTC):%Y-%m-%d}, `make campaign{' SHORT=1' if size == 'short' else ''}`, {minutes:.0f} min."
    page.write_text(f"{head}{BEGIN}\n{when}\n\n{as_table(parts)}\n{END}{tail}", encoding="utf-8")


def run_pages(size: str) -> Part:
    """Leave a page open under the live stream and move through a long session; return how it held."""
    promise = "A page that stays open under the live stream, and scrubs through a long session, keeps its memory"
    command = [sys.executable, "-m", "benchmarks.pages", "--minutes", str(PAGE_MINUTES[size])]
    command += ["--hours", str(PAGE_HOURS[size])]
    done = subprocess.run(command, cwd=ROOT, check=False, capture_output=True, text=True)
    heap = re.search(r"heap after warm-up.*?([+-]\d+\.\d+) MB", done.stdout)
    if done.returncode or heap is None or "LOST" in done.stdout or float(heap[1]) > HEAP_GROWTH_MB:
        print(done.stdout, done.stderr, sep="\n", file=sys.stderr)
        return Part(promise, "benchmarks/pages.py", 1, "FAILED", held=False)
    scrubbed = re.search(r"scrubbed: (.*)", done.stdout)
    moves = "" if scrubbed is None else f"; a session of {PAGE_HOURS[size]:g} h scrubbed, {scrubbed[1]}"
    result = f"{PAGE_MINUTES[size]:g} min of the live stream, heap {heap[1]} MB{moves}"
    print(f"pages: {result}", flush=True)
    return Part(promise, "benchmarks/pages.py", 1, result, held=True)


def main() -> int:
    """Run, tell how long it took, and keep the table of the full size."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", action="store_true", help="a part of each")
    parser.add_argument("--table", type=Path, metavar="FILE", help=f"write the table there (full: {PAGE.name})")
    options = parser.parse_args()
    size = "short" if options.short else "full"
    began_s = time.monotonic()
    parts = run_tests(size, "long", *(TESTS if size == "short" else (*TESTS, *FULL_ONLY)))
    parts += run_tests(size, "alone", *ALONE)
    parts += run_tests(size, "properties", *PROPERTIES, promise=ANYTHING)
    parts.append(run_pages(size))
    minutes = (time.monotonic() - began_s) / 60
    page = options.table or (PAGE if size == "full" else None)
    if page is not None:
        write_table(page, size, minutes, parts)
    has_held = all(part.held for part in parts)
    for part in parts:
        if not part.held:
            print(f"{part.test}: {part.result}")
    print(f"campaign ({size}): {'held' if has_held else 'FAILED'}, {minutes:.1f} min")
    return 0 if has_held else 1


if __name__ == "__main__":
    sys.exit(main())
