"""A day of everything in accelerated time leaves memory, descriptors and threads as they were after its first hour.

Rotating files, old sessions that go, alarms, restarts of the master, an unplugged cable, readers, exports and reports
(`tests/recorded/hurried_day.py`). `VOLTWALL_SOAK_HOURS` sets its length in hours of the car; 24 in `make campaign`, a
tenth in the short one, none in `make test`.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from app.live import trend
from tests.campaign import of_size, report_figure
from tests.service_process import N_CELLS

HOURS = float(os.environ.get("VOLTWALL_SOAK_HOURS") or of_size(0, 1, 3, 240) / 10)
FEWEST_HOURS = 3.0  # least hours with a verdict: the first hour warms up
MOST_GROWTH_MB = 5.0
TREND_MB = trend.LENGTH * len(trend.NAMES) * N_CELLS * 4 / 1e6  # taken as it fills
TREND_HOURS = trend.LENGTH * trend.EVERY_S / 3600


@pytest.mark.skipif(not HOURS, reason="make campaign runs it")
@pytest.mark.timeout(600 + HOURS * 1200)
def test_a_day_in_accelerated_time_leaves_the_service_as_it_was(tmp_path):
    command = [sys.executable, "-m", "tests.recorded.hurried_day", str(HOURS), "--data", str(tmp_path)]
    ran = subprocess.run(command, cwd=Path(__file__).parents[2], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr[-4000:]
    *lines, last = map(json.loads, ran.stdout.splitlines())
    assert last["wrong"] == []
    judge(np.array([[line[name] for name in ("hours", "mb", "descriptors", "threads")] for line in lines]), last)


def judge(looks: np.ndarray, told: dict) -> None:
    """Compare the last hour with the second."""
    hours = looks[:, 0]
    if HOURS < FEWEST_HOURS:
        report_figure(f"{hours[-1]:.1f} h in accelerated time, {told['done']}")
        return
    second, last = looks[(hours > 1) & (hours <= 2)], looks[hours > hours[-1] - 1]
    memory, descriptors, threads = (
        [float(np.median(part[:, column])) for part in (second, last)] for column in (1, 2, 3)
    )
    filling = TREND_MB * (min(1.0, (HOURS - 0.5) / TREND_HOURS) - 1.5 / TREND_HOURS)
    report_figure(
        f"{hours[-1]:.1f} h in accelerated time, {told['done']}: memory {memory[0]:.1f} MB in the second hour, "
        f"{memory[1]:.1f} in the last, of which {filling:.1f} are the trend that fills; descriptors "
        f"{descriptors[0]:.0f} and {descriptors[1]:.0f}, threads {threads[0]:.0f} and {threads[1]:.0f}"
    )
    assert memory[1] - memory[0] - filling < MOST_GROWTH_MB
    assert descriptors[1] == descriptors[0]
    assert threads[1] == threads[0]
