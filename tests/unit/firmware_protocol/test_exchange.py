import pytest

from firmware_protocol.errors import EncodeError
from firmware_protocol.exchange import (
    STORE_TIMEOUT_S,
    TIMEOUT_S,
    Exchange,
    ExchangeBusyError,
    GaveUp,
)
from firmware_protocol.framing import decode_chunk
from firmware_protocol.messages import IdentRequest, MessageType, Read, Reply, Result, Store, Write


def frame_of(raw):
    return decode_chunk(raw.strip(b"\0"))


def reply_to(raw, result=Result.DONE):
    frame = frame_of(raw)
    return Reply(frame.type, frame.sequence, result)


def test_reply_ends_the_request_and_the_next_has_the_next_sequence():
    exchange = Exchange(first_sequence=255)
    first = exchange.start(IdentRequest(), 0.0)
    assert exchange.on_reply(reply_to(first))
    assert not exchange.is_busy
    second = exchange.start(Read(0, 4), 0.1)
    assert [frame_of(raw).sequence for raw in (first, second)] == [255, 0]


def test_a_request_carries_no_time_of_the_host():
    assert frame_of(Exchange().start(IdentRequest(), 12.5)).uptime_ms == 0


def test_a_refusal_ends_the_request_too():
    exchange = Exchange()
    assert exchange.on_reply(reply_to(exchange.start(Store(), 0.0), Result.NOT_NOW))
    assert exchange.poll(100) is None


def test_one_request_at_a_time():
    exchange = Exchange()
    exchange.start(Store(), 0.0)
    with pytest.raises(ExchangeBusyError, match=r"^one request at a time$"):
        exchange.start(Store(), 0.0)


def test_request_that_does_not_fit_leaves_the_line_free():
    exchange = Exchange()
    with pytest.raises(EncodeError):
        exchange.start(Write(419, b"ab"), 0.0)
    assert not exchange.is_busy


@pytest.mark.parametrize(
    "stray",
    [
        Reply(MessageType.READ, 8, Result.DONE),
        Reply(MessageType.WRITE, 7, Result.DONE),
    ],
)
def test_reply_to_something_else_is_dropped(stray):
    exchange = Exchange(first_sequence=7)
    exchange.start(Read(0, 1), 0.0)
    assert not exchange.on_reply(stray)
    assert exchange.is_busy
    assert exchange.stray_replies == 1


def test_late_reply_after_the_end_is_dropped():
    exchange = Exchange()
    raw = exchange.start(Read(0, 1), 0.0)
    exchange.on_reply(reply_to(raw))
    for n in (1, 2):
        assert not exchange.on_reply(reply_to(raw))
        assert exchange.stray_replies == n


def test_a_reply_to_nothing_is_dropped():
    exchange = Exchange()
    assert not exchange.on_reply(Reply(MessageType.IDENT, 0, Result.DONE))
    assert exchange.stray_replies == 1
    assert frame_of(exchange.start(IdentRequest(), 0.0)).sequence == 0


def test_sequence_numbers_go_round_after_255_and_start_anywhere():
    exchange = Exchange(first_sequence=256 + 254)
    sequences = []
    for _ in range(3):
        raw = exchange.start(IdentRequest(), 0.0)
        sequences.append(frame_of(raw).sequence)
        exchange.on_reply(reply_to(raw))
    assert sequences == [254, 255, 0]


def test_a_single_try_gives_up_at_the_first_deadline():
    exchange = Exchange(tries=1)
    exchange.start(Read(0, 1), 5.0)
    assert exchange.poll(5.0 + TIMEOUT_S) == GaveUp(Read(0, 1), 1)
    assert exchange.poll(100.0) is None


def test_silence_sends_the_same_bytes_again_then_gives_up():
    exchange = Exchange()
    raw = exchange.start(Read(0, 1), 10.0)
    assert exchange.deadline_s == pytest.approx(10.0 + TIMEOUT_S)
    assert exchange.poll(10.0 + TIMEOUT_S - 1e-3) is None
    assert exchange.poll(10.0 + TIMEOUT_S) == raw
    assert exchange.poll(10.0 + TIMEOUT_S) is None
    assert exchange.poll(10.0 + 2 * TIMEOUT_S) == raw
    assert exchange.poll(10.0 + 3 * TIMEOUT_S) == GaveUp(Read(0, 1), 3)
    assert exchange.deadline_s is None
    assert exchange.start(Read(0, 1), 20.0) != raw


def test_a_store_is_given_more_time():
    exchange = Exchange()
    exchange.start(Store(), 0.0)
    assert exchange.poll(TIMEOUT_S) is None
    assert exchange.deadline_s == STORE_TIMEOUT_S
