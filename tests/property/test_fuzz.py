"""Bytes that reach different code of what reads them, found by coverage, and those that once broke it.

`make campaign` searches on (`tests/fuzz/run.py`, atheris; the C library by a loop of its own with gcc's coverage and
sanitizers): seconds a target, ten minutes in the long one (`LONG=1`). A find is put into `tests/fuzz/finds` and mended.
"""

import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.c_programs import build_fuzzer
from tests.campaign import campaign, of_size, report_figure
from tests.fuzz.targets import FOLDER, TARGETS, TooSlow, kept, limited, target

PROJECT = Path(__file__).parents[2]
SEARCH_S = of_size(0, 2, 20, 600)
PATIENCE_S = 120  # to start, on a machine that does other things too
C_TARGETS = ("link", "messages", "config", "can")


@pytest.mark.parametrize("name", sorted(TARGETS if SEARCH_S else TARGETS.keys() - {"http"}))  # test_openapi.py asks
def test_what_is_kept_of_a_target_breaks_no_promise(name):
    paths = kept(name)
    assert paths, "run tests/fuzz/run.py"
    for path in paths:
        target(name)(path.read_bytes())


def test_an_input_that_takes_too_long_breaks_a_target():
    def backtrack(data):
        re.fullmatch(rb"(a*)*b", data)  # doubles with each byte

    limited(backtrack, 0.2)(b"aaab")
    for tried in (backtrack, lambda data: [None for _ in iter(int, 1)]):
        with pytest.raises(TooSlow):
            limited(tried, 0.2)(b"a" * 40)


@pytest.mark.skipif(not SEARCH_S, reason="make campaign searches")
@pytest.mark.skipif(find_spec("atheris") is None, reason="pip install atheris (Linux on x86_64, macOS on arm64)")
@campaign(1, 300, 1200)
@pytest.mark.parametrize("name", sorted(TARGETS))
def test_no_bytes_break_a_target(name, tmp_path):
    command = [sys.executable, "-m", "tests.fuzz.run", name, str(SEARCH_S)]
    searched(command, name, "python", os.environ | {"VOLTWALL_FUZZ": str(tmp_path)}, tmp_path)


@campaign(60, 300, 1200)
@pytest.mark.parametrize("name", C_TARGETS)
def test_no_bytes_break_the_c_library(name, tmp_path):
    folders = [str(FOLDER / part / f"c_{name}") for part in ("corpus", "finds")]
    command = [str(build_fuzzer()), name, str(SEARCH_S), str(tmp_path), *folders]
    searched(command, name, "C", None, tmp_path)


def searched(command: list[str], name: str, of: str, environment: dict[str, str] | None, folder: Path) -> None:
    done = subprocess.run(
        command, cwd=PROJECT, env=environment, capture_output=True, text=True, errors="replace", check=False,
        timeout=SEARCH_S + PATIENCE_S,
    )  # fmt: skip
    said = (done.stdout + done.stderr)[-4000:]
    finds = [path.read_bytes().rstrip(b"\0").hex() for path in folder.glob("*-*") if path.is_file()]
    assert done.returncode == 0, f"{said}\n{finds}"
    runs = re.search(r"Done (\d+)", said)
    assert runs, said
    if SEARCH_S:
        report_figure(f"fuzzing: {name} ({of}), {runs[1]} inputs in {SEARCH_S} s, none broke it")
