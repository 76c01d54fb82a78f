import zipfile
from pathlib import Path

import can
import pytest

from app.sources.recordings.can_log import read_frames
from app.sources.recordings.kind import is_can_log, kind_of
from app.sources.recordings.table import TableUnreadable, load_table

FOREIGN = Path(__file__).parent / "foreign"
CANDUMP = "(1.5) can0 123#0102\n(1.6) can0 124#03\n"


@pytest.mark.parametrize(
    ("content", "kind"),
    [
        (CANDUMP, "candump"),
        ("  can0  123   [2]  01 02\n" * 3, "table"),  # candump without times
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
        (bytes(range(256)), "a binary file, no text"),
        (b"%PDF-1.4\n1 0 obj\n2 0 obj\n", r"^drive\.csv: a binary file, no text"),
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
