import tracemalloc

import pytest

from firmware_protocol import framing
from firmware_protocol.errors import EncodeError
from firmware_protocol.framing import BadFrame, BadReason, CommandDecoder, Frame, FrameDecoder, StreamCommand

START, STOP = StreamCommand(start=True), StreamCommand(start=False)
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


@pytest.mark.parametrize("decoder", [FrameDecoder(), CommandDecoder()])
def test_a_frame_without_an_end_does_not_fill_the_memory(decoder):
    piece = b"z" * 1_000
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


def test_master_takes_the_longest_frame_and_refuses_a_longer_one_with_its_start():
    longest = framing.encode_frame(1, 2, 3, b"\xaa" * framing.MAX_BODY)
    assert CommandDecoder().feed(longest) == [Frame(1, 2, 3, b"\xaa" * framing.MAX_BODY)]
    decoder = CommandDecoder()
    assert decoder.feed(b"\0" + b"z" * 600 + FRAME) == [BadFrame(BadReason.LONG, b"z" * framing.MAX_ENCODED), AS_FRAME]
    assert decoder.noise_bytes == 600


def test_bare_commands_count_at_once():
    decoder = CommandDecoder()
    assert decoder.feed(b"x") == [START]
    assert decoder.feed(b"yx") == [STOP, START]


def test_x_and_y_inside_a_frame_are_data():
    raw = framing.encode_frame(0x78, 0x79, 0x78797879, b"xyxyxy")
    decoder = CommandDecoder()
    assert [item for part in cut(raw, 1) for item in decoder.feed(part)] == [Frame(0x78, 0x79, 0x78797879, b"xyxyxy")]


@pytest.mark.parametrize("between", [b"x", b"y", b"xx"])
def test_commands_between_frames(between):
    commands = [StreamCommand(byte == ord("x")) for byte in between]
    assert CommandDecoder().feed(FRAME + between + FRAME) == [AS_FRAME, *commands, AS_FRAME]


def test_command_after_a_stray_delimiter_counts_at_the_next_or_after_silence():
    decoder = CommandDecoder()
    assert decoder.feed(b"\0x") == []
    assert decoder.feed(FRAME) == [START, AS_FRAME]
    assert decoder.feed(b"\0x") == []
    assert decoder.idle() == [START]
    assert decoder.feed(b"y") == [STOP]


def test_a_delimiter_after_a_command_may_open_a_frame():
    decoder = CommandDecoder()
    assert decoder.feed(b"\0x\0y") == [START], "y may be a frame's first byte"
    assert decoder.idle() == [STOP]


def test_a_chunk_of_nothing_but_commands_counts_up_to_a_frames_length():
    assert CommandDecoder().feed(b"\0" + b"x" * framing.MAX_ENCODED + b"\0") == [START] * framing.MAX_ENCODED
    [bad] = CommandDecoder().feed(b"\0" + b"x" * (framing.MAX_ENCODED + 1) + b"\0")
    assert bad.reason is BadReason.LONG


def test_a_capital_is_no_command():
    assert CommandDecoder().feed(b"\0X\0") == [BadFrame(BadReason.COBS, b"X")]


def test_silence_ends_a_frame_that_never_closed():
    decoder = CommandDecoder()
    assert decoder.feed(FRAME[:6]) == []
    assert [type(item) for item in decoder.idle()] == [BadFrame]
    assert decoder.feed(b"x") == [START]
    assert decoder.feed(FRAME) == [AS_FRAME]
    assert decoder.idle() == []


def test_silence_does_not_complete_a_frame_without_its_last_delimiter():
    decoder = CommandDecoder()
    decoder.feed(FRAME[:-1])
    assert decoder.idle() == []
    assert decoder.feed(b"x") == [START]


def test_frame_whose_first_delimiter_was_lost_is_a_frame_all_the_same():
    raw = framing.encode_frame(0x12, 1, 0, b"\x04\x00\x02\x00xy")
    assert CommandDecoder().feed(raw[1:]) == [Frame(0x12, 1, 0, b"\x04\x00\x02\x00xy")]


def test_commands_in_a_damaged_frame_without_its_first_delimiter_do_not_count():
    raw = bytearray(framing.encode_frame(0x12, 1, 0, b"\x04\x00\x02\x00xyyx"))
    raw[0] ^= 0x20
    raw[3] ^= 0x40
    out = CommandDecoder().feed(bytes(raw) + FRAME)
    assert [type(item) for item in out] == [BadFrame, Frame]


def test_a_frame_after_a_damaged_one_counts_though_one_delimiter_is_shared():
    damaged = bytearray(FRAME)
    damaged[3] ^= 1
    assert CommandDecoder().feed(bytes(damaged) + FRAME)[1:] == [AS_FRAME]
    assert CommandDecoder().feed(bytes(damaged) + FRAME[1:])[1:] == [AS_FRAME]


def test_commands_after_noise_and_silence_count():
    decoder = CommandDecoder()
    for _ in range(2):
        decoder.feed(b"\x13\xf7")
        decoder.idle()
        assert decoder.feed(b"x") == [START]
    assert decoder.noise_bytes == 4


def test_a_frame_that_silence_ended_is_noise():
    decoder = CommandDecoder()
    for _ in range(2):
        decoder.feed(FRAME[:-1])
        assert decoder.idle() == []
    assert decoder.noise_bytes == 2 * (len(FRAME) - 2)


def test_noise_is_counted_in_bytes_once():
    decoder = CommandDecoder()
    decoder.feed(b"\0abc\0" + FRAME + b"\0abcde")
    decoder.idle()
    assert decoder.noise_bytes == 8
