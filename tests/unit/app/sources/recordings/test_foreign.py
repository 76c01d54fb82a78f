"""Files of other systems: each is read with its own header, by content, with nothing said about it."""

import zipfile
from pathlib import Path

import numpy as np
import pytest

from app.sources.recordings.battery_log import battery_log
from app.sources.recordings.csv_table import TableUnreadable
from app.sources.recordings.dataset import load_recording
from app.sources.recordings.guess import guess
from app.sources.recordings.table import load_table
from app.words import render

FOREIGN = Path(__file__).parent / "foreign"


@pytest.mark.parametrize(
    (
        "name",
        "length_s",
        "cells",
        "current_a",
        "heat_degc",
    ),  # values of the last row; the current is positive on discharge
    [
        ("arbin.csv", 271.2135, 1, -2.650138, 24.68785),
        ("archive.csv", 20.0, 1, -0.55, 23.4),
        ("basytec.txt", 61.2359273, 1, -0.449601734, 25.47953),
        ("bdf.csv", 70960.0, 1, -0.006055158, None),
        ("biologic.mpt", 0.7, 1, None, 22.185871),
        ("date_stamp.csv", 1.5, 1, 1.3, None),
        ("digatron.csv", 68520.0, 1, -0.5, 36.49001),
        ("diybms.csv", 40.0, 3, None, 21.0),
        ("leafspy.csv", 20.0, 96, 14.5, None),
        ("maccor.csv", 14.06, 1, -28.798, 22.2591),
        ("maccor.txt", 90.88, 1, 0.49996, None),
        ("neware_flat.csv", 121.0, 1, -0.1, None),
        ("neware_layers.csv", 600.0, 1, 0.5, 25.3),
        ("novonix.csv", 78.83, 1, -0.49999133, 24.651),
        ("orion.csv", 0.4, 12, 16.3, 24.0),
        ("pec.csv", 19.998, 1, None, 19.26),
        ("vesc.csv", 0.2, 1, 12.1, None),
    ],
)
def test_a_file_of_another_system_imports_as_it_is(
    name: str, length_s: float, cells: int, current_a: float | None, heat_degc: float | None
) -> None:
    table = load_table(FOREIGN / name)
    log = battery_log(table, guess(table))
    assert log.time_s[-1] == pytest.approx(length_s, abs=0.01)
    assert log.voltages_v.shape[1] == cells
    assert 2.5 < np.nanmin(log.voltages_v) <= np.nanmax(log.voltages_v) < 4.3
    if current_a is not None:
        assert log.current_a[-1] == pytest.approx(current_a)
    if heat_degc is not None:
        assert log.temperatures_degc[-1, 0] == pytest.approx(heat_degc)


@pytest.mark.parametrize("name", ["arbin.csv", "biologic.mpt", "digatron.csv", "maccor.txt", "pec.csv"])
def test_a_test_of_one_cell_is_read_the_same_by_the_estimator(name: str) -> None:
    table = load_table(FOREIGN / name)
    profile = guess(table)
    log = battery_log(table, profile)
    recording = load_recording(FOREIGN / name, charge_positive=profile.charge_positive)
    np.testing.assert_allclose(np.unique(recording.current_a), np.unique(log.current_a))
    assert recording.time_s[-1] - recording.time_s[0] == pytest.approx(log.time_s[-1])


SPREADSHEET = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
OFFICE = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
PACKAGE = "http://schemas.openxmlformats.org/package/2006"


def cell(value: str | float) -> str:
    if isinstance(value, str):
        return f'<c t="inlineStr"><is><t>{value}</t></is></c>'
    return f"<c><v>{value}</v></c>"


def write_workbook(path: Path, sheets: dict[str, list[list[str | float]]]) -> Path:
    """Write the few parts that make a file Excel's."""
    names = "".join(f'<sheet name="{name}" sheetId="{k}" r:id="r{k}"/>' for k, name in enumerate(sheets, 1))
    links = "".join(
        f'<Relationship Id="r{k}" Type="{OFFICE}/worksheet" Target="worksheets/sheet{k}.xml"/>'
        for k in range(1, len(sheets) + 1)
    )
    with zipfile.ZipFile(path, "w") as packed:
        root = f'<Relationship Id="r" Type="{OFFICE}/officeDocument" Target="xl/workbook.xml"/>'
        packed.writestr("_rels/.rels", f'<Relationships xmlns="{PACKAGE}/relationships">{root}</Relationships>')
        packed.writestr("[Content_Types].xml", f'<Types xmlns="{PACKAGE}/content-types"/>')
        packed.writestr(
            "xl/workbook.xml", f'<workbook xmlns="{SPREADSHEET}" xmlns:r="{OFFICE}"><sheets>{names}</sheets></workbook>'
        )
        packed.writestr(
            "xl/_rels/workbook.xml.rels", f'<Relationships xmlns="{PACKAGE}/relationships">{links}</Relationships>'
        )
        for k, rows in enumerate(sheets.values(), 1):
            body = "".join(f"<row>{''.join(map(cell, row))}</row>" for row in rows)
            packed.writestr(
                f"xl/worksheets/sheet{k}.xml",
                f'<worksheet xmlns="{SPREADSHEET}"><sheetData>{body}</sheetData></worksheet>',
            )
    return path


def test_the_records_of_a_workbook_are_read(tmp_path: Path) -> None:
    pytest.importorskip("python_calamine")
    names = ["DataPoint", "Cycle Index", "Step Type", "Total Time", "Current(A)", "Voltage(V)", "Date"]
    rows: list[list[str | float]] = [
        [k, 1, "CC Chg", f"0:00:{10 * k:02d}", 1.5, 3.5 + k / 100, f"2026-05-01 12:00:{10 * k:02d}"] for k in range(5)
    ]
    path = write_workbook(tmp_path / "neware.dat", {"unit": [["Voltage", "V"]], "record": [[*names], *rows]})
    table = load_table(path)
    log = battery_log(table, guess(table))
    assert any("'record'" in render(note) for note in table.notes)
    np.testing.assert_allclose(log.time_s, [0, 10, 20, 30, 40])
    np.testing.assert_allclose(log.current_a, -1.5)
    np.testing.assert_allclose(log.voltages_v[:, 0], [3.5, 3.51, 3.52, 3.53, 3.54])


def test_a_damaged_workbook_is_refused_by_name(tmp_path: Path) -> None:
    pytest.importorskip("python_calamine")
    with zipfile.ZipFile(tmp_path / "bad.xlsx", "w") as packed:
        packed.writestr("xl/workbook.xml", "<workbook")
    with pytest.raises(TableUnreadable, match=r"bad\.xlsx: cannot be read"):
        load_table(tmp_path / "bad.xlsx")
