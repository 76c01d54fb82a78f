"""The master in C as cppcheck sees it: no warning, and of MISRA C:2012 only what the firmware page names as kept."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from firmware_protocol import c_header

C_FOLDER = Path(c_header.__file__).parent / "c"
PAGE = (C_FOLDER.parents[1] / "docs/howto/firmware.md").read_text(encoding="utf-8")
KEPT = set(re.findall(r"\b\d+\.\d+\b", PAGE.partition("## MISRA")[2].partition("\n## ")[0].partition("Kept")[2]))


@pytest.fixture(scope="module")
def found():
    if shutil.which("cppcheck") is None:
        pytest.skip("cppcheck is missing; install it (Debian: apt-get install cppcheck)")
    kinds = "--enable=warning,style,performance,portability"
    command = ["cppcheck", "--std=c99", "--addon=misra", kinds, "--quiet", "--template={id} {file}:{line} {severity}"]
    done = subprocess.run(
        [*command, "-I", str(C_FOLDER), str(C_FOLDER / "master")], capture_output=True, text=True, check=True
    )
    return [line.split() for line in done.stderr.splitlines() if "/master/" in line]


def test_cppcheck_warns_of_nothing(found):
    assert [line for line in found if not line[0].startswith("misra")] == []


def test_of_misra_only_what_the_page_names_is_kept(found):
    broken = {line[0].removeprefix("misra-c2012-"): line[1] for line in found if line[0].startswith("misra")}
    assert broken, "the addon has not run"
    assert {rule: place for rule, place in broken.items() if rule not in KEPT} == {}
