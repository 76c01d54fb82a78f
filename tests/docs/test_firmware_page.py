"""The firmware author's page: its code compiles. That its command lines are understood, test_command_lines.py shows."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs/howto/firmware.md").read_text(encoding="utf-8")
C_FOLDER = ROOT / "firmware_protocol/c"
HAL = ROOT / "tests/unit/firmware_protocol/hal"
C_BLOCK = PAGE.partition("```c\n")[2].partition("```")[0]
OF_THE_AUTHOR = """\
static void coulomb_counter_set(int32_t soc) { (void)soc; }
static bool relays_are_closed(void) { return false; }
"""
STATEMENTS = re.findall(r"`(vw_(?:memory|link_event)[^`]*;)`", PAGE)


@pytest.fixture(scope="module")
def gcc() -> str:
    found = shutil.which("gcc")
    if found is None:
        missing = "gcc is missing; install it (Debian: apt-get install gcc)"
        pytest.fail(missing) if os.environ.get("CI") else pytest.skip(missing)
    return found


def test_what_goes_into_main_compiles_against_the_hal(gcc: str, tmp_path: Path) -> None:
    head, init, loop = re.split(r"/\* after the MX_ functions \*/|/\* in the main loop \*/", C_BLOCK)
    assert len(STATEMENTS) == 2, "what stands in the text is code too"
    main = f"int main(void)\n{{\nuint16_t cell = 0;\n{init}\nfor (;;) {{\n{loop}\n{' '.join(STATEMENTS)}\n}}\n}}\n"
    include, _, rest = head.partition("\n")
    source = tmp_path / "main.c"
    source.write_text(f"{include}\n{OF_THE_AUTHOR}\n{rest}\n{main}", encoding="utf-8")
    # `context` belongs to the signature, whoever uses it
    flags = ["-std=c99", "-Wall", "-Wextra", "-Wno-unused-parameter", "-Werror", "-fsyntax-only"]
    command = [gcc, *flags, f"-I{C_FOLDER}", f"-I{HAL}", str(source)]
    built = subprocess.run(command, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr


@pytest.mark.parametrize("heading", ["Read the slaves", "The whole master"])
def test_an_example_compiles_with_every_warning(gcc: str, tmp_path: Path, heading: str) -> None:
    source = tmp_path / "example.c"
    source.write_text(PAGE.partition(f"## {heading}")[2].split("```c\n")[1].split("```")[0], encoding="utf-8")
    flags = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror", "-fsyntax-only"]
    built = subprocess.run([gcc, *flags, f"-I{C_FOLDER}", str(source)], capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
