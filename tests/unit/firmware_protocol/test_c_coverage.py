"""Every branch of the protection in C is taken, as gcov counts them, while it keeps what it promises."""

import ctypes
import gzip
import json
import random
import shutil
import subprocess
from dataclasses import replace

import pytest

from firmware_protocol.config_image import default_image
from simulator.bms_state import Latch
from tests.c_master import CProtection, Reading
from tests.c_programs import C_FOLDER, FLAGS, require_gcc
from tests.master_memory import Config

CONFIG = Config.from_image(default_image())
CALM = Reading(36_000, 3, 40_000, 7, 20, 1, 30, 9, 0, False, None, None, None, False)
CHANGES = (
    {}, {}, {}, {"v_min": 24_999}, {"v_max": 42_001}, {"t_min": -16}, {"t_max": 46}, {"i_fc": 20_001},
    {"i_fc": -10_001}, {"i_fc": -1_301, "is_charging": True}, {"i_fc": 101, "is_charging": True},
    {"i_fc": -1_300, "is_charging": True}, {"lost_slave": 2}, {"lost_cell": 40}, {"lost_temperature": 41},
    {"lost_current": True}, {"lost_cell": 4, "v_min": 0}, {"lost_slave": 7, "lost_current": True},
)  # fmt: skip
FLUSH = "void __gcov_dump(void);\nvoid flush_coverage(void);\nvoid flush_coverage(void)\n{\n    __gcov_dump();\n}\n"


@pytest.fixture
def counted(tmp_path):
    """The protection, compiled so that its branches are counted."""
    require_gcc()
    if shutil.which("gcov") is None:
        pytest.skip("gcov is missing; it comes with gcc (Debian: apt-get install gcc)")
    (tmp_path / "flush.c").write_text(FLUSH, encoding="utf-8")
    source, path = C_FOLDER / "master" / "vw_protection.c", tmp_path / "counted.so"
    command = ["gcc", *FLAGS, "-O0", "-fPIC", "-c", "--coverage", str(source), "-o", str(tmp_path / "vw_protection.o")]
    subprocess.run(command, cwd=tmp_path, check=True)
    objects = ("flush.c", "vw_protection.o")
    subprocess.run(["gcc", "-shared", "-fPIC", "--coverage", *objects, "-o", str(path)], cwd=tmp_path, check=True)
    return path


def branches_taken(folder) -> dict[int, list[int]]:
    """Return how often each branch was taken, by line."""
    subprocess.run(["gcov", "--json-format", "--branch-probabilities", "vw_protection.gcda"], cwd=folder, check=True,
                   capture_output=True)  # fmt: skip
    (report,) = folder.glob("vw_protection*.gcov.json.gz")
    (source,) = (one for one in json.loads(gzip.decompress(report.read_bytes()))["files"]
                 if one["file"].endswith("vw_protection.c"))  # fmt: skip
    return {line["line_number"]: [branch["count"] for branch in line["branches"]] for line in source["lines"]}


def test_every_branch_of_the_protection_is_taken(counted, tmp_path):
    rng = random.Random(2026)
    for _ in range(40):
        protection, is_ok = CProtection(Latch(), counted), True
        config, now_ms = replace(CONFIG, ts=rng.choice((1, 100, 200)), fc_avg=rng.choice((0, 10, 300))), 0
        for _ in range(40):
            changes = rng.choice(CHANGES)
            for _ in range(rng.choice((1, 2, 20))):
                now_ms += rng.choice((20, 20, 100))
                trips = protection.judge(config, replace(CALM, **changes), now_ms / 1000)
                is_ok = is_ok and not trips
                assert protection.is_ok == is_ok
            if rng.random() < 0.2:
                is_calm = changes in ({}, {"i_fc": -1_300, "is_charging": True})
                assert protection.clear() == is_calm
                is_ok = is_ok or is_calm
    ctypes.CDLL(str(counted)).flush_coverage()
    taken = branches_taken(tmp_path)
    assert sum(map(len, taken.values())) >= 40
    assert {line: counts for line, counts in taken.items() if 0 in counts} == {}
