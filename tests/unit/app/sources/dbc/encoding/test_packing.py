import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.sources.dbc.definitions import Layout
from app.sources.dbc.encoding.packing import Place, bounds, raw_number
from app.sources.dbc.extraction import physical_values, raw_values
from app.sources.dbc.frames import frames_of


@st.composite
def layouts(draw, size=8):
    length = draw(st.integers(1, min(64, 8 * size)))
    first = draw(st.integers(0, 8 * size - length))
    is_little = draw(st.booleans())
    start = first if is_little else first // 8 * 8 + 7 - first % 8
    scale = draw(st.sampled_from([1.0, 0.001, -0.1, 0.5, 2.0]))
    return Layout(
        start, length, is_little, draw(st.booleans()), scale=scale, offset=draw(st.sampled_from([0.0, -40.0]))
    )


def read(whole, layout, size=8):
    return raw_values(frames_of([(0, 1, whole.to_bytes(size, "little"))]).data, layout)


@given(layouts(), st.integers(0, 2**64 - 1), st.data())
def test_what_is_put_is_read_again_and_nothing_else_is_changed(layout, before, data):
    low, high = bounds(layout)
    raw = data.draw(st.integers(low, high))
    place = Place.of(layout, 8)
    whole = place.put(before, raw)
    assert int(read(whole, layout)[0]) == raw
    assert whole & ~place.mask == before & ~place.mask
    assert place.mask.bit_count() == layout.length


@given(layouts(size=64), st.data())
def test_frames_of_can_fd_have_places_too(layout, data):
    low, high = bounds(layout)
    raw = data.draw(st.integers(low, high))
    assert int(read(Place.of(layout, 64).put(0, raw), layout, 64)[0]) == raw


@given(st.floats(-1e6, 1e6), layouts())
def test_a_value_becomes_the_nearest_number_that_its_bits_hold(value, layout):
    raw = raw_number(value, layout)
    low, high = bounds(layout)
    assert low <= raw <= high
    if low < raw < high:
        assert abs(raw * layout.scale + layout.offset - value) <= 0.5000001 * abs(layout.scale)


@pytest.mark.parametrize(("bits", "exact"), [(16, 0.01), (32, 1e-5), (64, 0.0)])
def test_floats_are_told_as_their_bits(bits, exact):
    layout = Layout(0, bits, is_float=True)
    raw = raw_number(3.7123, layout)
    values = physical_values(read(Place.of(layout, 8).put(0, raw), layout), layout)
    assert values[0] == pytest.approx(3.7123, abs=exact)


def test_a_float_is_scaled_as_any_number():
    layout = Layout(0, 32, is_float=True, scale=0.001)
    assert raw_number(3.7, layout) == struct.unpack("<I", struct.pack("<f", 3700.0))[0]


def test_of_a_signal_beyond_the_frame_nothing_is_put():
    assert Place.of(Layout(64, 16), 8).put(0, 0xFFFF) == 0
    assert Place.of(Layout(71, 16, is_little_endian=False), 8).put(0, 0xFFFF) == 0


@pytest.mark.parametrize(
    ("layout", "expected"),
    [(Layout(0, 8), (0, 255)), (Layout(0, 8, is_signed=True), (-128, 127)), (Layout(0, 1), (0, 1))],
)
def test_bounds_are_those_of_the_bits(layout, expected):
    assert bounds(layout) == expected
