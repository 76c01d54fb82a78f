import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.sources.recordings.candump import NotCandump, candump_frames


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
    ],
)  # fmt: skip
def test_what_candump_writes_is_read(line, frame):
    assert list(candump_frames([line])) == [frame]


@pytest.mark.parametrize("line", ["(1.5) can0 123#R8", "(1.5) can0 20000004#0000000000000000", ""])
def test_remote_and_error_frames_are_left_out(line):
    assert list(candump_frames([line])) == []


def test_a_last_line_that_was_cut_off_is_left_out_and_any_other_refused():
    good = "(1.5) can0 123#00"
    assert len(list(candump_frames([good, "(1.6) can0 12"]))) == 1
    with pytest.raises(NotCandump):
        list(candump_frames(["time;id;data", good]))


@given(st.lists(st.text()))
def test_any_text_is_frames_or_an_error_of_ours(lines):
    with contextlib.suppress(ValueError):
        list(candump_frames(lines))
