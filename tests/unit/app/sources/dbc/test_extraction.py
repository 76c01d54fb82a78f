import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from app.sources.dbc.definitions import Layout
from app.sources.dbc.extraction import physical_values, raw_values


@st.composite
def numbers(draw):
    """Frames of one length, and a place in them."""
    length = draw(st.sampled_from([1, 2, 5, 7, 8, 12, 24, 48, 64]))
    bits = draw(st.integers(1, min(64, 8 * length)))
    first = draw(st.integers(0, 8 * length - bits))
    frames = draw(st.lists(st.binary(min_size=length, max_size=length), min_size=1, max_size=4))
    return length, bits, first, frames


@given(numbers(), st.booleans(), st.booleans())
def test_raw_numbers_are_those_of_whole_frames_as_one_integer(number, is_little, is_signed):
    length, bits, first, frames = number
    start = first if is_little else first // 8 * 8 + 7 - first % 8
    width = 8 if length <= 8 else 64
    data = np.frombuffer(b"".join(frame.ljust(width, b"\0") for frame in frames), np.uint8).reshape(-1, width)
    layout = Layout(start, bits, is_little, is_signed)
    expected = []
    for frame in frames:
        shift = first if is_little else 8 * length - first - bits
        value = (int.from_bytes(frame, "little" if is_little else "big") >> shift) & ((1 << bits) - 1)
        expected.append(value - (1 << bits) if is_signed and value >> (bits - 1) else value)
    assert raw_values(data, layout).tolist() == expected
    assert layout.end_byte <= length


def test_scale_and_offset_make_the_value():
    layout = Layout(0, 8, scale=0.25, offset=-40.0)
    data = np.array([[200, 0, 0, 0, 0, 0, 0, 0]], np.uint8)
    np.testing.assert_array_equal(physical_values(raw_values(data, layout), layout), [10.0])
