import zipfile
from pathlib import Path

import numpy as np
import pytest

from app.sources.recordings.battery_log import battery_log
from app.sources.recordings.csv_table import TableUnreadable
from app.sources.recordings.guess import guess
from app.sources.recordings.table import load_table
from app.words import render

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
