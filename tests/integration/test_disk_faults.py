"""Every call of the disk fails once: nothing that was acknowledged is lost, it is said, and the next try works.

The recorder, the history of the configuration, the EEPROM's file, profiles, settings, events, swaps, retention and
the lake, in a process with tests/integration/faulty_disk.c below SQLite. `make campaign` lets each call fail with each
error; `make test` a few of the small files' by chance, the same every time.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.c_programs import build_faulty_disk
from tests.campaign import SIZE, campaign, of_size

PROJECT = Path(__file__).parents[2]
SHARE = of_size(4, 8, 25, 100) / 100
QUICK = ("history", "eeprom", "profiles", "settings")  # milliseconds each
LONG = ("recorder", "events", "stores", "retention", "lake")


@pytest.mark.skipif(sys.platform != "linux" or not shutil.which("gcc"), reason="needs Linux and gcc")
@campaign(240, 900, 7200)
@pytest.mark.parametrize(
    ("names", "slower"),
    [
        pytest.param(QUICK, 1, id="small files"),
        pytest.param(LONG, 10, id="databases", marks=pytest.mark.skipif(SIZE == "sample", reason="in the campaign")),
    ],
)
def test_a_disk_that_fails_once_anywhere_loses_nothing_acknowledged(names, slower, tmp_path, tell):
    share = SHARE if SHARE == 1 else SHARE / slower
    environment = os.environ | {"LD_PRELOAD": str(build_faulty_disk()), "FAULT_FOLDER": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-m", "tests.disk_faults", str(tmp_path / "disk"), str(share), "1", *names],
        cwd=PROJECT, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    told = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    broken = [each for each in told if "broken" in each]
    assert not broken, json.dumps(broken, indent=1)
    assert done.returncode == 0, done.stderr[-2000:]
    tried = {each["scenario"]: each["tried"] for each in told}
    assert tried.keys() == set(names)
    assert sum(tried.values()) > 0
    counts = ", ".join(f"{name} {n}" for name, n in tried.items())
    tell(
        f"disk faults: one call failed in each of {sum(tried.values())} runs ({counts}), nothing acknowledged was lost"
    )
