"""The tables of docs/contributing/theses.md are what its command prints, and hold what the SOC thesis prints."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
CAR = (ROOT / "docs/explanation/simulated-car.md").read_text(encoding="utf-8")
PAGE = (ROOT / "docs/contributing/theses.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def printed() -> str:
    command = [sys.executable, "-m", "benchmarks.sources_tables"]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True, timeout=120).stdout


def test_the_page_shows_what_the_command_prints(printed: str) -> None:
    key_data, patterns, _units, passes = printed.strip().split("\n\n")
    lines = [line for part in (key_data, patterns, passes) for line in part.splitlines()]
    missing = [line for line in lines if line not in PAGE.splitlines()]
    assert missing == [], "python -m benchmarks.sources_tables prints these lines"


def test_the_balancing_of_all_cells_is_what_its_command_prints() -> None:
    command = [sys.executable, "-m", "benchmarks.balancing", "accumulator"]
    printed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True, timeout=110).stdout
    table = [line for line in printed.splitlines() if line.startswith("|")]
    assert len(table) == 6
    assert [line for line in table if line not in CAR.splitlines()] == []


@pytest.mark.parametrize(
    ("of", "numbers"),
    [  # as SPKF-2020 prints them in its Tables 1 to 3, wrong energies included
        ("cell", ("4.2 / 3.6 / 2.5 V", "2.5 Ah", "10.5 kJ", "45 g")),
        ("pack", ("50.4 / 43.2 / 30 V", "25 Ah", "1.26 MJ", "of 7.4 kg")),
        ("accumulator", ("403.2 / 345.6 / 240 V", "25 Ah", "10.08 MJ", "of 59.2 kg")),
    ],
)
def test_the_thesis_s_key_data_come_out_of_cell_and_layout(printed: str, of: str, numbers: tuple[str, ...]) -> None:
    (row,) = [line for line in printed.splitlines() if line.startswith(f"| {of} |")]
    assert [number for number in numbers if number not in row] == []


def test_the_right_energies_stand_beside_them(printed: str) -> None:
    for joule, unit, scale in ((3.6 * 2.5 * 3600, "kJ", 1e3), (345.6 * 25.0 * 3600, "MJ", 1e6)):
        assert f"| {joule / scale:.3g} {unit} |" in printed


def test_a_pattern_of_n_slices_draws_one_nth_of_the_charge(printed: str) -> None:
    rows = [line.split("|")[1:-1] for line in printed.splitlines() if line.rstrip().endswith(" % |")]
    assert len(rows) == 5
    for row in rows:
        slices, total = int(row[1]), float(row[2].removesuffix("C "))
        assert row[3].strip() == f"{3600.0 / total:.1f} s"
        assert row[5].strip() == f"{100.0 / slices:.2f} %"
