"""Lines of the logs of SavvyCAN, OVMS and candump: a frame, none, or the reason why it cannot be read."""

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.sources.recordings.bad_rows import UnreadableLine
from app.sources.recordings.line_logs import candump_frame, crtd_frame, savvycan_frame
from app.words import Message
from firmware_protocol.memory_map import CAN_ID_EXTENDED

EXTENDED = 0x18FF50E5 | CAN_ID_EXTENDED


@pytest.mark.parametrize(
    ("frame_of", "line", "frame"),
    [
        (savvycan_frame, "166064000,0000021A,false,Rx,0,3,FE,36,12,", (166.064, 0x21A, b"\xfe\x36\x12")),
        (savvycan_frame, "1500,18FF50E5,true,Tx,1,2,01,02", (0.0015, EXTENDED, b"\1\2")),
        # the format before 2017: no direction
        (savvycan_frame, "1500,0x131,false,0,3,01,02,03", (0.0015, 0x131, b"\1\2\3")),
        (savvycan_frame, "Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2", None),
        (crtd_frame, "1705316400.05 3R11 131 00 0F", (1705316400.05, 0x131, b"\0\x0f")),
        (crtd_frame, "1705316400.05 R29 18FF50E5 00", (1705316400.05, EXTENDED, b"\0")),
        (crtd_frame, "1705316400.05 2CEV Open", None),
        (crtd_frame, "1705316400.05 CXX OVMS CRTD", None),
        (crtd_frame, "# a remark", None),
        (candump_frame, "(1750000000.250000) can0 036#0190D41111\n", (1750000000.25, 0x036, b"\x01\x90\xd4\x11\x11")),
        (candump_frame, "(1.5) vcan0 18FF50E5#0102 R", (1.5, EXTENDED, b"\1\2")),
        (candump_frame, "(1.5) can0 345##1" + "AB" * 64, (1.5, 0x345, b"\xab" * 64)),
        (candump_frame, "(1.5) can0 123#", (1.5, 0x123, b"")),
        (candump_frame, " (1750000000.250000)  can0  036   [3]  01 90 D4", (1750000000.25, 0x036, b"\x01\x90\xd4")),
        (candump_frame, " (000.010000)  can1  RX - -  18FF50E5   [2]  01 02   '..'", (0.01, EXTENDED, b"\1\2")),
        (candump_frame, "(1970-01-01 00:00:02.500000)  can0  7FF   [0]", (2.5, 0x7FF, b"")),
        (candump_frame, "(1.5) can0 123#R8", None),  # a remote frame
        (candump_frame, "(1.5) can0 20000004#0000000000000000", None),  # an error frame
    ],
)  # fmt: skip
def test_a_line_is_a_frame_or_none(frame_of, line, frame) -> None:
    found = frame_of(line)
    assert (found and found[:3]) == (frame and (pytest.approx(frame[0]), *frame[1:]))


@pytest.mark.parametrize(
    ("frame_of", "line", "bus"),
    [
        (candump_frame, "(1750000000.250000) can0 036#0190D41111\n", "can0"),
        (candump_frame, " (1.5)  can1  18FF50E5   [2]  01 02", "can1"),
        (candump_frame, "(360.26) RX0 10 [2] D8 0E", "RX0"),  # an id of two digits
        (savvycan_frame, "1500,0000021A,false,Rx,1,1,FE", "1"),
        (savvycan_frame, "1500,0x131,false,2,1,01", "2"),
        (crtd_frame, "1705316400.05 3R11 131 00 0F", "3"),
        (crtd_frame, "1705316400.05 R11 131 00", ""),
    ],
)
def test_the_bus_of_a_frame_is_that_of_its_line(frame_of, line, bus) -> None:
    assert frame_of(line)[3] == bus


@pytest.mark.parametrize(
    ("frame_of", "lines", "codes"),
    [
        (
            savvycan_frame,
            ["1,131,false,Rx,0,8,00", "x,131,false,Rx,0,0", "1,2", "1,FFFFFFFF,true,Rx,0,0", ""],
            {"line-unlike", "line-cut", "line-id"},
        ),
        (crtd_frame, ["1.0 R11 FFF 00", "hello", "1.0 R11 131 0", "(1.0) can0 123#00"], {"line-unlike", "line-id"}),
        (candump_frame, ["(1.5) can0 123#012", "(1.5) can0 123##0" + "AB" * 65], None),  # half a byte, too many
        (candump_frame, ["(1.5)  can0  123   [65]  " + "AB " * 65], None),
        (candump_frame, [f"({time}) can0 123#01" for time in ("nan", "inf", "-1e300", "yesterday")], None),
        (candump_frame, ["(2026-13-01 00:00:00) can0 123#01"], None),
    ],
)
def test_another_line_is_no_line_of_the_system(frame_of, lines, codes) -> None:
    for line in lines:
        with pytest.raises(UnreadableLine) as refused:
            frame_of(line)
        assert codes is None or refused.value.why.code in codes


@given(st.text())
def test_any_text_is_a_frame_or_a_reason(line: str) -> None:
    for frame_of in (savvycan_frame, crtd_frame, candump_frame):
        with contextlib.suppress(UnreadableLine):
            frame_of(line)


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
    expected = (float(at_s), can_id, data, "can0") if at_s < 9_000_000_000 else None
    assert [frame_or_none(line) for line in lines] == [expected] * len(lines)
