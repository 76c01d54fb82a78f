import tracemalloc

import pytest

from firmware_protocol import framing
from firmware_protocol.errors import EncodeError
from firmware_protocol.framing import BadFrame, BadReason, Frame, FrameDecoder

FRAME = framing.encode_frame(0x11, 7, 0, b"\x00\x00\x04\x00")
AS_FRAME = Frame(0x11, 7, 0, b"\x00\x00\x04\x00")


def cut(data, n):
    return [data[i : i + n] for i in range(0, len(data), n)]


def test_crc16_check_value():
    assert framing.crc16(b"123456789") == 0x29B1


@pytest.mark.parametrize(
    ("data", "encoded"),
    [  # the examples of the COBS paper and its public descriptions
        ("00", "0101"),
        ("0000", "010101"),
        ("001100", "01021101"),
        ("11220033", "0311220233"),
        ("11223344", "0511223344"),
        ("11000000", "0211010101"),
    ],
)
def test_cobs_published_examples(data, encoded):
    assert framing.cobs_encode(bytes.fromhex(data)).hex() == encoded
    assert framing.cobs_decode(bytes.fromhex(encoded)).hex() == data


def test_cobs_block_of_254():
    block = bytes(range(1, 255))
    assert framing.cobs_encode(block) == b"\xff" + block
    assert framing.cobs_encode(block + b"\xff") == b"\xff" + block + b"\x02\xff"
    assert framing.cobs_encode(b"\0" + block) == b"\x01\xff" + block
    assert framing.cobs_encode(block + b"\0") == b"\xff" + block + b"\x01\x01"


@pytest.mark.parametrize("encoded", ["", "05112233", "0311", "ff01", "021100", "00"])
def test_cobs_that_is_none(encoded):
    assert framing.cobs_decode(bytes.fromhex(encoded)) is None


def test_frame_on_the_line():
    # type 11, sequence 07, uptime 0, offset 0, length 4, CRC over these ten bytes
    payload = bytes.fromhex("11 07 00000000 0000 0400")
    crc = framing.crc16(payload).to_bytes(2, "little")
    assert framing.encode_frame(0x11, 7, 0, payload[6:]) == (
        bytes.fromhex("00 03 11 07 01 01 01 01 01 02 04 03") + crc + b"\0"
    )


def test_sequence_and_uptime_wrap():
    [frame] = FrameDecoder().feed(framing.encode_frame(1, 256 + 3, (1 << 32) + 5, b""))
    assert (frame.sequence, frame.uptime_ms) == (3, 5)


def test_longest_body_passes_and_a_longer_one_is_refused():
    [frame] = FrameDecoder().feed(framing.encode_frame(1, 0, 0, b"\xaa" * framing.MAX_BODY))
    assert len(frame.body) == framing.MAX_BODY
    assert len(frame.raw) == framing.MAX_ENCODED
    with pytest.raises(EncodeError) as refused:
        framing.encode_frame(1, 0, 0, bytes(framing.MAX_BODY + 1))
    assert (refused.value.field, refused.value.value, refused.value.limit) == ("body", "513 bytes", "at most 512 bytes")


@pytest.mark.parametrize(
    ("chunk", "reason"),
    [
        (b"\x05abc", BadReason.COBS),
        (framing.cobs_encode(b"seven__"), BadReason.SHORT),
        (b"\x01" * (framing.MAX_ENCODED + 1), BadReason.LONG),
        (framing.cobs_encode(bytes(framing.MAX_PAYLOAD + 1)), BadReason.LONG),
        (FRAME[1:-2] + b"\x55", BadReason.CRC),
    ],
)
def test_bad_chunk_names_its_reason(chunk, reason):
    [bad] = FrameDecoder().feed(b"\0" + chunk + b"\0")
    assert bad == BadFrame(reason, chunk[: framing.MAX_ENCODED])
    assert framing.decode_chunk(chunk) == bad


def test_host_drops_the_tail_of_a_frame_it_saw_no_start_of():
    decoder = FrameDecoder()
    assert decoder.feed(FRAME[5:] + FRAME) == [AS_FRAME]
    assert decoder.skipped_bytes == len(FRAME) - 6


def test_host_counts_every_byte_before_the_first_delimiter():
    decoder = FrameDecoder()
    assert [item for part in cut(b"z" * 1234 + FRAME, 7) for item in decoder.feed(part)] == [AS_FRAME]
    assert decoder.skipped_bytes == 1234


def test_a_frame_without_an_end_does_not_fill_the_memory():
    decoder, piece = FrameDecoder(), b"z" * 1_000
    decoder.feed(b"\0")
    tracemalloc.start()
    for _ in range(20):
        decoder.feed(piece)
    kept, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert kept < 5_000


def test_host_does_not_count_a_frame_split_over_feeds_as_skipped():
    decoder = FrameDecoder()
    assert [item for part in cut(FRAME * 3, 4) for item in decoder.feed(part)] == [AS_FRAME] * 3
    assert decoder.skipped_bytes == 0


def test_host_gets_the_frame_after_an_endless_one():
    decoder = FrameDecoder()
    out = [item for part in cut(b"\0" + b"z" * 5000 + FRAME, 100) for item in decoder.feed(part)]
    assert out == [BadFrame(BadReason.LONG, b"z" * framing.MAX_ENCODED), AS_FRAME]
