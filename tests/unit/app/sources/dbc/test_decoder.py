import cantools
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.decoder import by_message, decode_frames
from app.sources.dbc.frames import frames_of
from tests.campaign import examples
from tests.peer_messages import HEAD

TEXT = """BO_ 256 Plain: 8 BMS
 SG_ A : 0|8@1+ (0.5,-10) [0|0] "degC" X
 SG_ B : 8|8@1- (1,0) [0|0] "" X

BO_ 257 Nested: 8 BMS
 SG_ Outer M : 0|4@1+ (1,0) [0|0] "" X
 SG_ Inner m1M : 4|4@1+ (1,0) [0|0] "" X
 SG_ Value m2 : 8|8@1+ (1,0) [0|0] "" X

SG_MUL_VAL_ 257 Inner Outer 1-1;
SG_MUL_VAL_ 257 Value Inner 2-2, 4-4;
"""
DEFINITIONS = parse_definitions((HEAD + TEXT).encode(), "x.dbc")


def series(*frames):
    return decode_frames(frames_of(list(frames)), DEFINITIONS)


def test_every_value_has_the_time_of_its_frame():
    found = series((10, 0x100, b"\x14\xff"), (15, 0x7FF, b"\x01"), (20, 0x100, b"\x1e\x02"))
    assert found["Plain", "A"].t_ns.tolist() == [10, 20]
    np.testing.assert_array_equal(found["Plain", "A"].values, [0.0, 5.0])
    np.testing.assert_array_equal(found["Plain", "B"].values, [-1.0, 2.0])


def test_a_frame_that_is_too_short_for_a_signal_does_not_carry_it():
    found = series((10, 0x100, b"\x14"), (20, 0x100, b"\x14\x07"))
    assert found["Plain", "A"].t_ns.tolist() == [10, 20]
    assert found["Plain", "B"].t_ns.tolist() == [20]
    assert ("Plain", "B") not in series((10, 0x100, b"\x14"))


def test_a_nested_signal_needs_all_its_multiplexers():
    found = series(*((k, 0x101, bytes([outer | inner << 4, k])) for k, (outer, inner) in enumerate(
        [(1, 2), (1, 3), (0, 2), (1, 4)]
    )))  # fmt: skip
    assert found["Nested", "Value"].t_ns.tolist() == [0, 3]
    assert found["Nested", "Inner"].t_ns.tolist() == [0, 1, 3]
    assert found["Nested", "Outer"].t_ns.tolist() == [0, 1, 2, 3]


def test_frames_of_unknown_messages_are_left_out_and_rows_keep_their_order():
    frames = frames_of([(k, (0x100, 0x300, 0x101)[k % 3], b"\x00\x00") for k in range(9)])
    rows = {group.message.name: at.tolist() for at, group in by_message(frames, DEFINITIONS.by_id())}
    assert rows == {"Plain": [0, 3, 6], "Nested": [2, 5, 8]}
    assert list(by_message(frames_of([]), DEFINITIONS.by_id())) == []
    assert list(by_message(frames, {})) == []


@st.composite
def layouts(draw):
    """Signals of a message that do not overlap, each in the bytes of its own."""
    found, first = [], 0
    while first < 8 and len(found) < 4:
        size = draw(st.integers(1, min(4, 8 - first)))
        bits = draw(st.integers(1, 8 * size))
        is_little, sign = draw(st.booleans()), draw(st.sampled_from("+-"))
        start = 8 * first if is_little else 8 * first + 7
        factor, offset = draw(st.sampled_from([1, 0.5, 0.001, -2])), draw(st.sampled_from([0, -40, 2.5]))
        found.append(f' SG_ S{len(found)} : {start}|{bits}@{int(is_little)}{sign} ({factor},{offset}) [0|0] "V" X\n')
        first += size
    return "".join(found)


@settings(max_examples=examples(40))
@given(layouts(), st.lists(st.binary(min_size=8, max_size=8), min_size=1, max_size=5))
def test_values_of_any_message_are_those_by_cantools(lines, datas):
    text = f"{HEAD}BO_ 256 M: 8 BMS\n{lines}"
    reference = cantools.database.load_string(text, database_format="dbc")
    found = decode_frames(
        frames_of([(k, 256, data) for k, data in enumerate(datas)]), parse_definitions(text.encode(), "x.dbc")
    )
    for k, data in enumerate(datas):
        for name, value in reference.decode_message(256, data).items():
            assert found["M", name].values[k] == pytest.approx(value, abs=1e-9)


@given(st.lists(st.tuples(st.integers(0, 15), st.integers(0, 15), st.integers(0, 255)), min_size=1, max_size=12))
def test_nested_multiplexers_of_any_values_are_those_by_cantools(told):
    reference = cantools.database.load_string(HEAD + TEXT, database_format="dbc")
    frames = [(k, 257, bytes([outer | inner << 4, value])) for k, (outer, inner, value) in enumerate(told)]
    found = series(*frames).get(("Nested", "Value"))
    expected = []
    for k, _, data in frames:
        try:
            decoded = reference.decode_message(257, data, allow_truncated=True)
        except cantools.database.DecodeError:  # cantools refuses a value under which nothing stands
            continue
        if "Value" in decoded:
            expected.append((k, decoded["Value"]))
    assert ([] if found is None else list(zip(found.t_ns.tolist(), found.values.tolist(), strict=True))) == expected
