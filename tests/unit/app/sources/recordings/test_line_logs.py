"""Lines of the logs of SavvyCAN, OVMS and candump: a frame, none, or the reason why it cannot be read."""

import contextlib
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.sources.recordings.bad_rows import UnreadableLine
from app.sources.recordings.line_logs import candump_frame, crtd_frame, savvycan_frame
from app.words import Message
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


@pytest.mark.parametrize(
    ("frame_of", "lines"),
    [
        (savvycan_frame, ["1,131,false,Rx,0,8,00", "x,131,false,Rx,0,0", "1,2", "1,FFFFFFFF,true,Rx,0,0", ""]),
        (crtd_frame, ["1.0 R11 FFF 00", "hello", "1.0 R11 131 0", "(1.0) can0 123#00"]),
    ],
)
def test_another_line_is_no_line_of_the_system(frame_of: Callable[[str], object], lines: list[str]) -> None:
    for line in lines:
        with pytest.raises(UnreadableLine) as refused:
            frame_of(line)
        assert refused.value.why.code in ("line-unlike", "line-cut", "line-id")


@given(st.text())
def test_any_text_is_a_frame_or_a_reason(line: str) -> None:
    for frame_of in (savvycan_frame, crtd_frame, candump_frame):
        with contextlib.suppress(UnreadableLine):
            frame_of(line)


@pytest.mark.parametrize(
    ("line", "frame"),
    [
        ("(1750000000.250000) can0 036#0190D41111\n", (1750000000.25, 0x036, b"\x01\x90\xd4\x11\x11")),
        ("(1.5) vcan0 18FF50E5#0102 R", (1.5, 0x98FF50E5, b"\x01\x02")),
        ("(1.5) can0 345##1" + "AB" * 64, (1.5, 0x345, b"\xab" * 64)),
        ("(1.5) can0 123#", (1.5, 0x123, b"")),
        (" (1750000000.250000)  can0  036   [3]  01 90 D4", (1750000000.25, 0x036, b"\x01\x90\xd4")),
        (" (000.010000)  can1  RX - -  18FF50E5   [2]  01 02   '..'", (0.01, 0x98FF50E5, b"\x01\x02")),
        ("(1970-01-01 00:00:02.500000)  can0  7FF   [0]", (2.5, 0x7FF, b"")),
        ("(1.5) can0 123#R8", None),  # a remote frame
        ("(1.5) can0 20000004#0000000000000000", None),  # an error frame
    ],
)  # fmt: skip
def test_what_candump_writes_is_read(line, frame):
    assert candump_frame(line) == frame


@pytest.mark.parametrize(
    "line",
    [
        "(1.5) can0 123#012",
        "(1.5) can0 123##0" + "AB" * 65,
        "(1.5)  can0  123   [65]  " + "AB " * 65,
        "(nan) can0 123#01",
        "(inf) can0 123#01",
        "(-1e300) can0 123#01",
        "(yesterday) can0 123#01",
        "(2026-13-01 00:00:00) can0 123#01",
    ],
)
def test_half_a_byte_more_bytes_than_a_frame_has_and_a_time_that_is_none_are_refused(line):
    with pytest.raises(UnreadableLine):
        candump_frame(line)


def test_a_refusal_shows_the_line_but_not_all_of_a_long_one():
    with pytest.raises(UnreadableLine) as refused:
        candump_frame("x" * 5000)
    assert refused.value.why == Message("line-unlike", shape="(TIME) BUS ID#BYTES", text="x" * 60)


def frame_or_none(line):
    try:
        return candump_frame(line)
    except UnreadableLine:
        return None


@given(st.decimals(0, 9_999_999_999, places=6), st.integers(0, 0xFFF), st.binary(max_size=64))
def test_any_frame_is_read_however_it_is_written_in_the_file_and_on_the_terminal(at_s, can_id, data):
    fd = f"({at_s}) can0 {can_id:03X}##1{data.hex().upper()}"
    lines = [fd + "\n", fd.lower(), f" {fd} R\n", fd.replace("##1", "##0")]
    lines += [fd.replace("##1", "#")] * (len(data) <= 9)
    lines.append(f" ({at_s})  can0  {can_id:03X}   [{len(data)}]  {data.hex(' ')}")
    expected = (float(at_s), can_id, data) if at_s < 9_000_000_000 else None
    assert [frame_or_none(line) for line in lines] == [expected] * len(lines)
