import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.sources.recordings.bad_rows import UnreadableLine
from app.sources.recordings.line_logs import crtd_frame, savvycan_frame
from firmware_protocol.memory_map import CAN_ID_EXTENDED


@pytest.mark.parametrize(
    ("line", "frame"),
    [
        ("166064000,0000021A,false,Rx,0,8,FE,36,12,FE,69,05,07,AD,", (166.064, 0x21A, "fe3612fe690507ad")),
        ("1500,18FF50E5,true,Tx,1,2,01,02", (0.0015, 0x18FF50E5 | CAN_ID_EXTENDED, "0102")),
        ("1500,0x131,false,0,3,01,02,03", (0.0015, 0x131, "010203")),  # of before 2017: no direction
        ("Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2", None),
    ],
)
def test_a_line_of_savvycan(line: str, frame: tuple[float, int, str] | None) -> None:
    found = savvycan_frame(line)
    assert (found and (pytest.approx(found[0]), found[1], found[2].hex())) == frame


@pytest.mark.parametrize(
    ("line", "frame"),
    [
        ("1705316400.05 3R11 131 00 0F", (1705316400.05, 0x131, "000f")),
        ("1705316400.05 R29 18FF50E5 00", (1705316400.05, 0x18FF50E5 | CAN_ID_EXTENDED, "00")),
        ("1705316400.05 2CEV Open", None),
        ("1705316400.05 CXX OVMS CRTD", None),
        ("# a remark", None),
    ],
)
def test_a_line_of_crtd(line: str, frame: tuple[float, int, str] | None) -> None:
    found = crtd_frame(line)
    assert (found and (found[0], found[1], found[2].hex())) == frame


@pytest.mark.parametrize("line", ["1,131,false,Rx,0,8,00", "x,131,false,Rx,0,0", "1,2", "1,FFFFFFFF,true,Rx,0,0", ""])
def test_another_line_is_no_line_of_savvycan(line: str) -> None:
    with pytest.raises(UnreadableLine) as refused:
        savvycan_frame(line)
    assert refused.value.why.code in ("line-unlike", "line-cut", "line-id")


@pytest.mark.parametrize("line", ["1.0 R11 FFF 00", "hello", "1.0 R11 131 0", "(1.0) can0 123#00"])
def test_another_line_is_no_line_of_crtd(line: str) -> None:
    with pytest.raises(UnreadableLine) as refused:
        crtd_frame(line)
    assert refused.value.why.code in ("line-unlike", "line-id")


@given(st.text())
def test_any_text_is_a_frame_or_a_reason(line: str) -> None:
    for frame_of in (savvycan_frame, crtd_frame):
        with contextlib.suppress(UnreadableLine):
            frame_of(line)
