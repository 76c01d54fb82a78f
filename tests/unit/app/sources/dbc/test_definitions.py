"""Where a signal stands, compared with what cantools makes of the same definition."""

import cantools
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.definitions import Definitions, Layout, MessageDefinition, Oddity, Signal
from tests.campaign import examples

HEAD = 'VERSION ""\nNS_ :\nBS_:\nBU_: BMS\n'


def least_length(layout):
    """Bytes from which on cantools takes the signal into a message."""
    line = f' SG_ S : {layout.start}|{layout.length}@{int(layout.is_little_endian)}+ (1,0) [0|0] "" X\n'
    for size in range(1, 65):
        text = f"{HEAD}BO_ 1 M: {size} BMS\n{line}"
        try:
            cantools.database.load_string(text, database_format="dbc", strict=True)
        except cantools.database.Error:
            continue
        return size
    raise AssertionError


@settings(max_examples=examples(25))
@given(st.integers(0, 63), st.integers(1, 32), st.booleans())
def test_the_bytes_that_a_signal_needs_are_those_by_cantools(start, length, is_little):
    layout = Layout(start, length, is_little)
    assert layout.end_byte == least_length(layout)


@pytest.mark.parametrize(
    ("start", "length", "is_little", "end"),
    [(0, 8, True, 1), (0, 9, True, 2), (7, 2, True, 2), (7, 8, False, 1), (7, 16, False, 2), (0, 2, False, 2),
     (56, 8, True, 8), (15, 8, False, 2), (448, 64, True, 64)],
)  # fmt: skip
def test_the_bytes_that_a_signal_needs(start, length, is_little, end):
    assert Layout(start, length, is_little).end_byte == end


def message(can_id, name, *signals):
    return MessageDefinition(can_id, name, 8, tuple(Signal(each, Layout(0, 8)) for each in signals))


def test_of_two_messages_with_one_id_the_first_counts():
    first, second = message(1, "A"), message(1, "B")
    assert Definitions((first, second, message(2, "C"))).by_id()[1] is first


def test_a_second_file_adds_its_messages_and_its_oddities_and_changes_nothing_of_the_first():
    one = Definitions((message(1, "A"),), (Oddity("a.dbc", 3, "x"),))
    other = Definitions((message(1, "B"), message(2, "C")), (Oddity("b.dbc", None, "y"),))
    joined = one.joined(other)
    assert {i: each.name for i, each in joined.by_id().items()} == {1: "A", 2: "C"}
    assert [each.file for each in joined.oddities] == ["a.dbc", "b.dbc"]


def test_a_signal_is_found_by_its_whole_name():
    found = message(1, "A", "V1", "V10")
    assert found.signal("V10").name == "V10"
    assert found.signal("V") is None
    assert found.signal("v1") is None


@given(st.integers(0, 63), st.integers(1, 16), st.booleans(), st.booleans())
def test_a_parsed_signal_has_the_place_of_the_file(start, length, is_little, is_signed):
    sign = "-" if is_signed else "+"
    line = f' SG_ S : {start}|{length}@{int(is_little)}{sign} (0.5,-3) [0|0] "V" X\n'
    (found,) = parse_definitions(f"{HEAD}BO_ 1 M: 64 BMS\n{line}".encode(), "x.dbc").messages
    assert found.signals[0].layout == Layout(start, length, is_little, is_signed, scale=0.5, offset=-3.0)
