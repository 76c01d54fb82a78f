"""Runs what takes long: many examples, kills, power cuts, noise, a day of racing, every route, pages for minutes.

`make campaign` runs all of it, `make campaign SHORT=1` a part of each. Each prints what it found in one line. The tests
are those of `make test` in a larger size (`tests/campaign.py`); the pages are measured by `benchmarks/pages.py`.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PROPERTIES = ("-m", "hypothesis", "tests/unit", "tests/property", "tests/numeric")
TESTS = (
    "tests/unit/app/analysis/evidence/test_timing.py",
    "tests/numeric/test_joints_race.py",
    "tests/numeric/test_prediction_coverage.py",
    "tests/numeric/test_energy_target_race.py",
    "tests/integration/test_openapi.py",
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
    "tests/integration/test_recorder_starved.py",
    "tests/integration/test_season_campaign.py",
    "tests/integration/test_season_s3.py",
    "tests/integration/test_bad_radio.py",
    "tests/integration/test_simulator_c_codec.py",
    "tests/integration/test_connection_flood.py",
    "tests/integration/test_stop_at_once.py",
    "tests/e2e/test_layout.py",
    "tests/unit/app/sources/dbc/test_hostile_bus.py",
    "tests/unit/app/sessions/transfer/test_broken_logs.py",
    "tests/unit/app/sessions/transfer/test_follow.py",
    "tests/unit/app/sessions/reading/test_check.py::test_no_damaged_copy_is_called_sound_although_its_content_differs",
)
IN_EVERY_THEME = ("tests/e2e/test_pages.py", "tests/e2e/test_debrief.py")  # the short campaign would repeat `make test`
PAGE_MINUTES = {"short": 0.5, "full": 6.0}
PAGE_HOURS = {"short": 0.5, "full": 4.0}
HEAP_GROWTH_MB = 8.0  # more than a garbage collection leaves behind by chance


def run_tests(size: str, what: str, *chosen: str) -> bool:
    """Run tests in a size and print their figures and how many there were; tell whether all passed."""
    with tempfile.TemporaryDirectory() as folder:
        figures = Path(folder) / "figures"
        figures.touch()
        environment = os.environ | {"VOLTWALL_CAMPAIGN": size, "VOLTWALL_FIGURES": str(figures)}
        command = [sys.executable, "-m", "pytest", "-q", "-n", "2", "--dist", "load", "--maxprocesses", "2", *chosen]
        done = subprocess.run(command, cwd=ROOT, env=environment, check=False, capture_output=True, text=True)
        lines = sorted(figures.read_text(encoding="utf-8").splitlines())
    print(*lines, f"{what}: {(done.stdout.splitlines() or ['nothing'])[-1]}", sep="\n", flush=True)
    if done.returncode:
        print(done.stdout, done.stderr, sep="\n", file=sys.stderr)
    return done.returncode == 0


def run_pages(size: str) -> bool:
    """Leave a page open under the live stream and move through a long session; tell whether it held."""
    command = [sys.executable, "-m", "benchmarks.pages", "--minutes", str(PAGE_MINUTES[size])]
    command += ["--hours", str(PAGE_HOURS[size])]
    done = subprocess.run(command, cwd=ROOT, check=False, capture_output=True, text=True)
    heap = re.search(r"heap after warm-up.*?([+-]\d+\.\d+) MB", done.stdout)
    if done.returncode or heap is None or "LOST" in done.stdout or float(heap[1]) > HEAP_GROWTH_MB:
        print(done.stdout, done.stderr, sep="\n", file=sys.stderr)
        return False
    scrubbed = re.search(r"scrubbed: (.*)", done.stdout)
    moves = "" if scrubbed is None else f"; a session of {PAGE_HOURS[size]:g} h scrubbed, {scrubbed[1]}"
    print(f"pages: {PAGE_MINUTES[size]:g} min of the live stream, heap {heap[1]} MB{moves}", flush=True)
    return True


def main() -> int:
    """Run and tell how long it took."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", action="store_true", help="a part of each")
    size = "short" if parser.parse_args().short else "full"
    began_s = time.monotonic()
    long = TESTS if size == "short" else (*TESTS, *IN_EVERY_THEME)
    held = [run_tests(size, "long", *long), run_tests(size, "properties", *PROPERTIES), run_pages(size)]
    print(f"campaign ({size}): {'held' if all(held) else 'FAILED'}, {(time.monotonic() - began_s) / 60:.1f} min")
    return 0 if all(held) else 1


if __name__ == "__main__":
    sys.exit(main())
