"""Files by their content and text in any characters; what is no table, in words."""

import zipfile
from pathlib import Path

import can
import numpy as np
import pytest

from app.errors import ImportFailed
from app.sources.recordings.battery_log import battery_log
from app.sources.recordings.can_log import read_frames
from app.sources.recordings.guess import guess
from app.sources.recordings.kind import is_can_log, kind_of
from app.sources.recordings.table import TableUnreadable, load_table, read_table

FOREIGN = Path(__file__).parent / "foreign"
CANDUMP = "(1.5) can0 123#0102\n(1.6) can0 124#03\n"


@pytest.mark.parametrize(
    ("content", "kind"),
    [
        (CANDUMP, "candump"),
        ("  can0  123   [2]  01 02\n" * 3, "candump-no-time"),
        (" (000.010000)  can1  18FF50E5   [2]  01 02\n", "candump"),
        ("date Fri Nov 20 10:00:00.000 am 2026\nbase hex  timestamps absolute\n", "asc"),
        (";$FILEVERSION=1.3\n;$STARTTIME=45713.5\n", "trc"),
        ("Time Stamp,ID,Extended,Dir,Bus,LEN,D1\n1,131,false,Rx,0,1,00\n", "savvycan"),
        ("# OVMS\n1705316400.05 3R11 131 00\n1705316400.06 3R11 131 00\n", "crtd"),
        ("time,current,voltage\n0,1,3.7\n", "table"),
        ("", "table"),
        (b"\x89PNG\r\n\x1a\n\0\0\0", "unknown"),
        (b"SQLite format 3\0", "session"),
        (b"BIO-LOGIC MODULAR FILE\x1a", "mpr"),
        (b"NEWARE\x01\x02", "nda"),
        (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "xls"),
        ("t,I\n0,1\n".encode("utf-16"), "table"),
    ],
)
@pytest.mark.parametrize("name", ["recording", "drive.csv", "drive.txt"])
def test_a_file_is_what_it_holds_not_what_it_is_called(
    tmp_path: Path, content: str | bytes, kind: str, name: str
) -> None:
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    assert kind_of(path) == kind


def test_a_workbook_is_known_among_archives(tmp_path: Path) -> None:
    for inside, kind in (("xl/workbook.xml", "xlsx"), ("data.ndc", "ndax"), ("photo.jpg", "zip")):
        with zipfile.ZipFile(tmp_path / "file", "w") as packed:
            packed.writestr(inside, "x")
        assert kind_of(tmp_path / "file") == kind


@pytest.mark.parametrize("ending", ["asc", "trc", "blf"])
def test_logs_of_python_can_are_known_under_another_name(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"drive.{ending}"
    with can.Logger(path) as logger:
        for number in range(4):
            logger.on_message_received(
                can.Message(timestamp=1.78e9 + number, arbitration_id=5, data=b"ab", is_extended_id=False)
            )
    renamed = path.rename(tmp_path / "drive.bin")
    assert kind_of(renamed) == ending
    assert is_can_log(renamed)
    assert [frame[1:] for frame in read_frames(renamed)] == [(5, b"ab")] * 4


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (bytes(range(256)), "not a text file"),
        (b"%PDF-1.4\n1 0 obj\n2 0 obj\n", r"^drive\.csv: not a text file"),
        (
            b"BIO-LOGIC MODULAR FILE\x1a".ljust(48) + bytes(4) + b"MODULEVMP Set   ",
            r"a BioLogic \.mpr: export it as text \(\.mpt\) from EC-Lab",
        ),
        (b"\0\1\0\0Standard Jet DB\0", r"an Arbin \.res .*export it as CSV from MITS Pro"),
    ],
)
def test_what_is_no_text_is_said_to_be_none(tmp_path: Path, content: bytes, said: str) -> None:
    (tmp_path / "drive.csv").write_bytes(content)
    with pytest.raises(TableUnreadable, match=said):
        load_table(tmp_path / "drive.csv")


@pytest.mark.parametrize(("name", "frames"), [("savvycan.csv", 9), ("kcan.crtd", 7)])
def test_logs_of_savvycan_and_ovms_are_read(name: str, frames: int) -> None:
    assert is_can_log(FOREIGN / name)
    assert len(list(read_frames(FOREIGN / name))) == frames


ROWS = [(10.0 * i, -1.5, 3.7 + 0.001 * i, 25.0) for i in range(12)]
CHINESE = "测试时间(s),电流(A),电压(V),温度(℃)"
GERMAN = "Prüfzeit [s];Strom / A;Zellspannung / V;Zelltemperatur / °C"


def table_text(names: str, delimiter: str = ",", comma: str = ".") -> str:
    lines = (delimiter.join(f"{value:.4f}".replace(".", comma) for value in row) for row in ROWS)
    return "\n".join([names, *lines, ""])


@pytest.mark.parametrize(
    ("text", "encoding"),
    [
        (table_text(CHINESE), "utf-8"),
        (table_text(CHINESE), "utf-8-sig"),
        (table_text(CHINESE), "gb18030"),
        (table_text(CHINESE), "utf-16"),
        (table_text(GERMAN, ";", ","), "utf-8"),
        (table_text(GERMAN, ";", ","), "latin-1"),
        (table_text(GERMAN, ";", ","), "cp1252"),
        (table_text("Temps (s),Courant (A),Tension (V),Température (°C)"), "latin-1"),
        (table_text("Time (s),Current (A),Voltage (V),Temp (C)"), "utf-16-le"),
        (table_text("Time (s),Current (A),Voltage (V),Temp (C)"), "utf-16-be"),
    ],
)
def test_a_table_is_read_in_the_characters_it_was_written_in(tmp_path: Path, text: str, encoding: str) -> None:
    file = tmp_path / "cell.csv"
    file.write_bytes(text.encode(encoding))
    table = read_table(file)
    log = battery_log(table, guess(table))
    time_s, current_a, voltage_v, heat_degc = np.array(ROWS).T
    np.testing.assert_allclose(log.time_s, time_s)
    np.testing.assert_allclose(np.abs(log.current_a), np.abs(current_a))
    np.testing.assert_allclose(log.voltages_v[:, 0], voltage_v)
    np.testing.assert_allclose(log.temperatures_degc[:, 0], heat_degc)


def test_hours_minutes_and_seconds_of_a_chinese_cycler_are_its_time(tmp_path: Path) -> None:
    lines = [f"{i + 1},0:{i:02d}:30.500,1500.0,3700.0" for i in range(20)]
    file = tmp_path / "neware.csv"
    file.write_bytes("\n".join(["数据序号,总时间(h:min:s),电流(mA),电压(mV)", *lines]).encode("gb18030"))
    table = read_table(file)
    log = battery_log(table, guess(table))
    assert log.time_s[-1] == 19 * 60.0
    assert abs(log.current_a[0]) == 1.5
    assert log.voltages_v[0, 0] == 3.7


def test_only_names_are_said_to_be_that(tmp_path: Path) -> None:
    (tmp_path / "names.csv").write_text("Time (s),Current (A),Voltage (V)\n")
    with pytest.raises(ImportFailed, match=r"^names\.csv: only names and no row of numbers below them: 'Time"):
        read_table(tmp_path / "names.csv")


def test_an_archive_of_tables_is_refused_with_what_is_in_it(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "runs.zip", "w") as packed:
        for name in ("runs/a.csv", "runs/b.csv"):
            packed.writestr(name, table_text(CHINESE))
    with pytest.raises(ImportFailed, match=r"^runs\.zip: a zip archive with 'runs/a\.csv', 'runs/b\.csv': unpack it"):
        read_table(tmp_path / "runs.zip")


def test_a_table_without_a_current_names_the_file_its_columns_and_the_command_that_shows_them(tmp_path: Path) -> None:
    (tmp_path / "speeds.csv").write_text("Time (s),Speed\n0,1\n1,2\n")
    table = read_table(tmp_path / "speeds.csv")
    with pytest.raises(
        ImportFailed, match=r"^speeds\.csv: current is not named.*'Time \(s\)', 'Speed'.*`voltwall sessions columns"
    ):
        battery_log(table, guess(table))
