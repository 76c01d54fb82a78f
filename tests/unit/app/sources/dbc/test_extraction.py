import struct

import numpy as np
import pytest
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


@pytest.mark.parametrize(("bits", "code"), [(16, "e"), (32, "f"), (64, "d")])
@pytest.mark.parametrize("is_little", [True, False])
@given(number=st.floats(-1e4, 1e4, width=16))
def test_floats_of_every_length_are_those_of_their_bytes(bits, code, is_little, number):
    packed = struct.pack(("<" if is_little else ">") + code, number).ljust(8, b"\0")
    layout = Layout(0 if is_little else 7, bits, is_little, is_float=True)
    found = physical_values(raw_values(np.frombuffer(packed, np.uint8).reshape(1, 8), layout), layout)
    assert found.tolist() == [number]


@given(st.lists(st.binary(min_size=8, max_size=8), min_size=1, max_size=5), st.integers(0, 48), st.integers(1, 16))
def test_a_frame_of_classic_can_reads_the_same_in_a_log_with_can_fd(datas, start, bits):
    classic = np.frombuffer(b"".join(datas), np.uint8).reshape(-1, 8)
    fd = np.zeros((len(datas), 64), np.uint8)
    fd[:, :8] = classic
    layout = Layout(start, bits)
    assert raw_values(classic, layout).tolist() == raw_values(fd, layout).tolist()
    assert raw_values(fd[:, ::-1][:, ::-1], layout).tolist() == raw_values(fd, layout).tolist()


def test_a_negative_number_with_a_scale_is_negative():
    layout = Layout(0, 12, is_signed=True, scale=0.5, offset=1.0)
    data = np.array([[0xFE, 0x0F, 0, 0, 0, 0, 0, 0]], np.uint8)
    assert physical_values(raw_values(data, layout), layout).tolist() == [0.0]


@pytest.mark.parametrize("is_little", [True, False])
@pytest.mark.parametrize("is_signed", [True, False])
@given(value=st.integers(0, 2**64 - 1), shift=st.integers(1, 7), first=st.integers(0, 55))
def test_a_number_that_spans_nine_bytes_of_a_long_frame_is_whole(is_little, is_signed, value, shift, first):
    frame = (value << shift).to_bytes(9, "little" if is_little else "big")
    data = np.zeros((2, 64), np.uint8)
    data[1, first : first + 9] = np.frombuffer(frame, np.uint8)
    start = 8 * first + shift if is_little else 8 * first + 7 - (8 - shift)
    expected = value - (1 << 64) if is_signed and value >> 63 else value
    assert raw_values(data, Layout(start, 64, is_little, is_signed)).tolist() == [0, expected]
