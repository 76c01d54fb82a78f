"""What is told of a recording before it is imported: columns, first rows as they would be, what is in the way."""

import json
from dataclasses import asdict

import pytest

from app.sources.recordings.import_mapping import ImportMapping
from app.sources.recordings.preview import ROWS, preview
from app.words import render

PROFILE = ImportMapping(time="t", current="I", voltages="C{n}")
DBC = """
VERSION ""
BU_: BMS
BO_ 256 Pack: 2 BMS
 SG_ PackCurrent : 0|16@1- (0.1,0) [0|0] "A" BMS
BO_ 257 Cells: 3 BMS
 SG_ CellID : 0|8@1+ (1,0) [0|0] "" BMS
 SG_ CellVoltage : 8|16@1+ (0.0005,0) [0|0] "V" BMS
"""
HEADER = "t,I,C1,C2,C3\n"


@pytest.fixture
def path(tmp_path):
    rows = "".join(f"{1_780_000_000_000 + 100 * k},{-12 - k},3700,3710,\n" for k in range(50))
    (tmp_path / "theirs.csv").write_text(HEADER + rows)
    return tmp_path / "theirs.csv"


def test_the_first_rows_are_shown_in_our_units_which_the_values_tell(path):
    found = preview(path, PROFILE, ["time", "voltage"])
    assert (found.profile.time_unit, found.profile.voltage_unit, found.profile.current_unit) == ("ms", "mV", "A")
    rows = found.understood
    assert (rows.rows, rows.started_unix_s) == (50, 1_780_000_000)
    assert rows.length_s == pytest.approx(4.9, abs=1e-6)
    assert len(rows.time_s) == len(rows.voltages_v) == ROWS
    assert rows.time_s[1] == pytest.approx(0.1, abs=1e-6)
    assert rows.current_a[:2] == (-12, -13)
    assert rows.voltages_v[0] == (pytest.approx(3.7), pytest.approx(3.71), None)
    assert (rows.soc, rows.temperatures_degc) == ((), ())
    assert found.error is None
    json.dumps(asdict(found), allow_nan=False)


def test_columns_and_cells_are_told_with_samples(path):
    found = preview(path, ImportMapping(current="I", voltages="C{n}", voltage_unit="mV", cells="1,3"), [])
    assert [column.name for column in found.columns] == ["t", "I", "C1", "C2", "C3"]
    assert found.columns[1].samples == (-12, -13, -14)
    assert found.columns[4].samples == (None, None, None)
    assert [cell.name for cell in found.cells] == ["C1", "C2", "C3"]
    assert len(found.understood.voltages_v[0]) == 2
    assert found.cells[1].median_v == pytest.approx(3.71)
    assert found.cells[2].median_v is None


@pytest.mark.parametrize(
    ("change", "error"),
    [
        ({"current": "Strom"}, "no such column"),
        ({"current": ""}, "current is not named"),
        ({"cells": "7"}, "there is no cell 7"),
        ({"voltage_unit": "V"}, "no cell voltage is within"),
    ],
)
def test_what_is_in_the_way_is_told_beside_the_columns(path, change, error):
    found = preview(path, ImportMapping(**{**asdict(PROFILE), "voltage_unit": "mV", "time_unit": "ms"} | change), [])
    assert found.understood is None
    assert error in render(found.error)
    assert len(found.columns) == 5


def test_a_can_log_is_told_by_its_dbc(tmp_path):
    log, dbc = tmp_path / "bus.log", tmp_path / "bus.dbc"
    dbc.write_text(DBC)
    frames = ("101#00201C", "101#012A1C", "100#7B00")  # two cells, then the current
    log.write_text("".join(f"({1_780_000_000 + k / 10:.6f}) can0 {frames[k % 3]}\n" for k in range(30)))
    nothing = preview(log, ImportMapping(), [], dbc)
    assert "current is not named" in render(nothing.error)
    assert "PackCurrent" in [column.name for column in nothing.columns]
    named = ImportMapping(current="PackCurrent", voltages="CellVoltage[CellID]", voltage_unit="mV")
    found = preview(log, named, ["voltage", "time"], dbc)
    assert found.error is None
    assert (found.profile.voltages, found.profile.voltage_unit, found.profile.time) == (named.voltages, "V", "")
    assert len(found.cells) == len(found.understood.voltages_v[0]) == 2
    assert found.understood.current_a[0] == pytest.approx(12.3)
