"""Only whole lines of an slcan adapter are frames."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.sources.links.can_bus import is_whole, open_bus
from tests.campaign import examples


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


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        *((answer, True) for answer in ("\r", "\a", "z\r", "F00\r", "V1013\r")),
        *((cut, False) for cut in ("t", "t100\r", "t1009\r", "tXYZ20102\r", "t10020102t10020102\r")),
    ],
)
def test_answers_are_left_alone_and_what_is_no_frame_is_none(text, expected):
    assert is_whole(text) is expected


@pytest.fixture
def adapter():
    """A bus whose serial port hears what is written to it."""
    bus = open_bus({"interface": "slcan", "channel": "loop://", "bitrate": 500_000, "sleep_after_open": 0.0})
    while bus.serialPortOrig.in_waiting:
        bus.recv(0.0)  # the commands that opened it
    yield bus
    bus.shutdown()


def heard(adapter, *lines):
    adapter.serialPortOrig.write("".join(lines).encode())
    found = []
    while adapter.serialPortOrig.in_waiting:
        message = adapter.recv(0.05)
        found += [] if message is None else [(message.arbitration_id, bytes(message.data))]
    return found


def test_an_adapter_delivers_whole_frames_of_both_kinds_of_id(adapter):
    first, second = line("t", 0x7FF, b"\x01\x02"), line("T", 0x18FF50E5, bytes(8))
    assert heard(adapter, first, second) == [(0x7FF, b"\x01\x02"), (0x18FF50E5, bytes(8))]


def test_two_lines_that_became_one_are_no_frame_and_the_next_one_is(adapter):
    first, second, third = (line("t", i, bytes([i] * 8)) for i in (1, 2, 3))
    assert heard(adapter, first[:9] + second, third) == [(3, bytes([3] * 8))]
    assert heard(adapter, first[:-3] + "\r", second) == [(2, bytes([2] * 8))]


@settings(max_examples=examples(15))
@given(st.binary(min_size=8, max_size=8), st.binary(min_size=8, max_size=8), st.integers(5, 20), st.integers(1, 15))
def test_bytes_that_are_lost_behind_an_id_give_no_cell_the_value_of_another_frame(first, second, begin, lost):
    lines = line("t", 0x100, first) + line("t", 0x101, second)
    damaged = lines[:begin] + lines[begin + lost :]
    for each in damaged.split("\r"):
        if each[:1] == "t" and is_whole(each + "\r"):
            found = int(each[1:4], 16), bytes.fromhex(each[5:21])
            assert found in ((0x100, first), (0x101, second))
