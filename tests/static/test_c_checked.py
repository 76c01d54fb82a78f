"""The master in C as cppcheck sees it: no warning, and of MISRA C:2012 only the intended deviations."""

import shutil
import subprocess
from pathlib import Path

import pytest

from firmware_protocol import c_header

C_FOLDER = Path(c_header.__file__).parent / "c"
INTENDED = {
    "2.3, 2.4, 2.5, 8.7": "used by the firmware, not by the library",
    "5.9": "static functions of one name in two files",
    "8.9": "tables at the head of a file",
    "9.3": "only the first element of an array given",
    "10.1, 10.4": "enumerators compared with the byte that carries them",
    "10.6, 10.7": "composite expressions of small unsigned numbers",
    "10.8": "a sum that is cast",
    "11.5": "the `void *` of the callbacks",
    "11.8, 21.15": "the struct is sent as bytes",
    "12.1": "precedence where it is obvious",
    "12.2": "shifts whose distance the addon cannot bound",
    "12.3": "two variables in a declaration",
    "13.4": "an assignment used as a value",
    "14.2, 15.7": "a loop in the COBS decoder, an `if` chain without `else`",
    "15.5": "several returns in a function",
    "17.8": "parameters as variables",
    "18.4": "pointer arithmetic on byte buffers",
    "20.7, 20.10": "the generated X-macros",
}
KEPT = {rule for rules in INTENDED for rule in rules.split(", ")}


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


def test_of_misra_only_the_intended_deviations_are_left(found):
    broken = {line[0].removeprefix("misra-c2012-"): line[1] for line in found if line[0].startswith("misra")}
    assert broken, "the addon has not run"
    assert {rule: place for rule, place in broken.items() if rule not in KEPT} == {}
