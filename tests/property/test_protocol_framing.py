"""Any bytes, any chunks, any noise: decoders return, stay in bounds and find the next frame.

The master's decoder is that of `tests/spec_codec.py`, with which `test_c_against_python.py` compares the one in C.
"""

import contextlib

from hypothesis import assume, example, given
from hypothesis import strategies as st

from firmware_protocol import framing, messages
from firmware_protocol.errors import DecodeError
from firmware_protocol.framing import BadFrame, Frame, FrameDecoder
from tests.spec_codec import master_decoder

BODIES = st.binary(max_size=framing.MAX_BODY)
FRAMES = st.builds(Frame, st.integers(0, 255), st.integers(0, 255), st.integers(0, (1 << 32) - 1), BODIES)
SMALL_FRAMES = st.builds(
    Frame, st.integers(0, 255), st.integers(0, 255), st.integers(0, (1 << 32) - 1), st.binary(max_size=40)
)
COMMANDS = st.sampled_from(("start", "stop"))
# bytes that matter to the decoders, far oftener than by chance
NOISE = st.lists(st.sampled_from(b"\0\0\0xy\x01\x02\x05\xff") | st.integers(0, 255), max_size=700).map(bytes)


def on_the_line(item):
    if isinstance(item, str):
        return b"x" if item == "start" else b"y"
    return framing.encode_frame(item.type, item.sequence, item.uptime_ms, item.body)


def read_by_master(wire, silence=False):
    return [item if isinstance(item, str) else Frame(*item) for item in master_decoder(wire, silence)]


def fed_in_parts(decoder, raw, sizes):
    out, position = [], 0
    while position < len(raw):
        size = sizes[position % len(sizes)]
        out += decoder.feed(raw[position : position + size])
        position += size
    return out


SIZES = st.lists(st.integers(1, 600), min_size=1, max_size=5)


@given(st.binary(max_size=1200))
@example(bytes(range(1, 255)))
@example(bytes(range(1, 256)) * 2)
def test_cobs_there_and_back_without_zeros(data):
    encoded = framing.cobs_encode(data)
    assert 0 not in encoded
    assert framing.cobs_decode(encoded) == data
    assert len(encoded) <= len(data) + max(1, (len(data) + 253) // 254)


@given(st.binary(max_size=700))
def test_cobs_decoding_gives_data_or_none(encoded):
    data = framing.cobs_decode(encoded)
    assert data is None or len(data) < len(encoded)


@given(st.lists(FRAMES, max_size=4))
def test_host_gets_every_frame(frames):
    decoder = FrameDecoder()
    assert decoder.feed(b"".join(map(on_the_line, frames))) == frames
    assert decoder.skipped_bytes == 0


@given(NOISE, SIZES)
def test_chunks_change_nothing_for_the_host(raw, sizes):
    whole, parts = FrameDecoder(), FrameDecoder()
    assert fed_in_parts(parts, raw, sizes) == whole.feed(raw)
    assert parts.skipped_bytes == whole.skipped_bytes


@given(st.lists(SMALL_FRAMES | COMMANDS, max_size=12))
def test_x_and_y_are_commands_between_frames_and_data_inside(items):
    assert read_by_master(b"".join(map(on_the_line, items))) == items


@given(st.lists(SMALL_FRAMES, min_size=1, max_size=5), st.data())
def test_one_damaged_byte_never_makes_a_command(frames, data):
    raw = bytearray(b"".join(map(on_the_line, frames)))
    at = data.draw(st.integers(0, len(raw) - 1))
    became = data.draw(st.integers(0, 255))
    assume(became != raw[at] and became not in b"xy\0")
    raw[at] = became
    out = read_by_master(bytes(raw), silence=True)
    assert not {"start", "stop"} & {item for item in out if isinstance(item, str)}
    assert sum(isinstance(item, Frame) for item in out) >= len(frames) - 2


@given(NOISE, SMALL_FRAMES)
def test_host_finds_the_frame_after_any_noise(noise, frame):
    out = FrameDecoder().feed(b"\0" + noise + on_the_line(frame))
    assert out[-1] == frame


@given(NOISE, SMALL_FRAMES, COMMANDS)
def test_master_finds_the_frame_after_any_noise(noise, frame, command):
    assert read_by_master(noise + on_the_line(frame) + on_the_line(command))[-2:] == [frame, command]


@given(st.binary(max_size=1500), SIZES)
def test_memory_stays_bounded(raw, sizes):
    decoder = FrameDecoder()
    for item in fed_in_parts(decoder, raw.replace(b"\0", b"\1"), sizes):
        assert not isinstance(item, BadFrame) or len(item.raw) <= framing.MAX_ENCODED
    assert len(decoder._buffer) <= framing.MAX_ENCODED


@given(st.integers(0, 255), st.binary(max_size=64))
def test_any_body_decodes_or_raises_decode_error(kind, body):
    frame = Frame(kind, 0, 0, body)
    with contextlib.suppress(DecodeError):
        messages.decode_message(frame)


@given(st.sampled_from([0x01, 0x02, 0x03]), st.binary(max_size=64))
def test_message_that_decodes_encodes_to_the_same_bytes(kind, body):
    try:
        message = messages.decode_message(Frame(kind, 0, 0, body))
    except DecodeError:
        return
    assert message.to_body() == body
