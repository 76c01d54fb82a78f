"""Only whole lines of an slcan adapter are frames."""

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.sources.links.slcan_lines import is_whole, open_bus


def line(kind, can_id, data):
    code = (*range(9), 12, 16, 20, 24, 32, 48, 64).index(len(data))
    width = 3 if kind in "tdb" else 8
    return f"{kind}{can_id:0{width}X}{code:X}{data.hex().upper()}\r"


@given(st.sampled_from("tTdDbB"), st.integers(0, 0x7FF), st.sampled_from([1, 7, 8, 12, 48, 64]), st.data())
def test_a_whole_line_counts_and_one_that_lost_bytes_does_not(kind, can_id, length, draw):
    if kind in "tT" and length > 8:
        length = 8
    whole = line(kind, can_id, bytes(range(length)))
    assert is_whole(whole)
    assert is_whole(whole[:-1] + "1A2F\r")  # with the adapter's timestamp
    header = 5 if kind in "tdb" else 10
    first = draw.draw(st.integers(header, len(whole) - 2))
    lost = draw.draw(st.integers(1, len(whole) - 1 - first))
    assert not is_whole(whole[:first] + whole[first + lost :])  # bytes of the data
    assert not is_whole(whole[:first] + whole)  # the end of the line, and the next one is whole


@pytest.mark.parametrize("text", ["\r", "\a", "z\r", "F00\r", "V1013\r"])
def test_answers_are_left_alone(text):
    assert is_whole(text)


@pytest.mark.parametrize("text", ["t", "t100\r", "t1009\r", "tXYZ20102\r", "t10020102t10020102\r"])
def test_what_is_no_frame_is_none(text):
    assert not is_whole(text)


def test_other_interfaces_are_opened_as_ever():
    with open_bus({"interface": "virtual", "channel": "voltwall-lines"}) as bus:
        assert isinstance(bus, can.BusABC)
