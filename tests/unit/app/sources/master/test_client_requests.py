"""What each request puts on the line, and what its answer or its silence means for the one who asked."""

from itertools import pairwise

import pytest

from app.errors import LinkLost, MasterRefused, MasterSilent
from app.sources.master.client import MasterClient
from firmware_protocol.errors import EncodeError
from firmware_protocol.exchange import TRIES
from firmware_protocol.framing import Frame, FrameDecoder
from firmware_protocol.messages import (
    EEPROM_READ_BASE,
    MAX_READ,
    NO_OFFSET,
    Command,
    CommandId,
    IdentRequest,
    MessageType,
    Read,
    Reply,
    Result,
    decode_request,
)
from tests.fake_clock import FakeClock


class Master:
    """Answers before `send` returns, or lets time pass; keeps the requests it was sent."""

    def __init__(self, *, result=Result.DONE, offset=NO_OFFSET, data=None, is_silent=False):
        self.clock = FakeClock()
        self.frames: list[Frame] = []
        self.result, self.offset, self.data, self.is_silent = result, offset, data, is_silent
        self.client = MasterClient(self.send, self.clock)
        self._decoder = FrameDecoder()
        self.is_unplugged = False

    @property
    def requests(self):
        return [decode_request(frame) for frame in self.frames]

    def send(self, raw):
        if self.is_unplugged:
            raise LinkLost("unplugged")
        for frame in self._decoder.feed(raw):
            self.frames.append(frame)
            if self.is_silent:
                self.clock.advance(5.0)
                continue
            request = decode_request(frame)
            data = self.data
            if data is None:
                data = bytes(request.length) if isinstance(request, Read) else b""
            self.client.on_reply(Reply(frame.type, frame.sequence, self.result, self.offset, data))


def test_each_request_has_its_frame():
    master = Master()
    master.client.identify()
    master.client.write(4, b"\x1c\xa2")
    master.client.store()
    master.client.load()
    master.client.request(Command(CommandId.SET_SOC, 9991))
    assert [(frame.type, frame.body.hex()) for frame in master.frames] == [
        (MessageType.IDENT, ""),
        (MessageType.WRITE, "040002001ca2"),
        (MessageType.STORE, ""),
        (MessageType.LOAD, ""),
        (MessageType.COMMAND, "0707270000"),
    ]


def test_requests_follow_each_other_with_numbers_of_their_own():
    master = Master()
    for _ in range(300):
        master.client.identify()
    sequences = [frame.sequence for frame in master.frames]
    assert all((b - a) % 256 == 1 for a, b in pairwise(sequences))


@pytest.mark.parametrize(
    ("offset", "length", "parts"),
    [
        (0, 1, [(0, 1)]),
        (0, MAX_READ, [(0, MAX_READ)]),
        (100, MAX_READ + 1, [(100, MAX_READ), (100 + MAX_READ, 1)]),
        (EEPROM_READ_BASE, 2 * MAX_READ, [(EEPROM_READ_BASE, MAX_READ), (EEPROM_READ_BASE + MAX_READ, MAX_READ)]),
        (0, 0, []),
    ],
)
def test_a_read_takes_as_many_requests_as_it_needs(offset, length, parts):
    master = Master()
    assert len(master.client.read(offset, length)) == length
    assert master.requests == [Read(*part) for part in parts]


@pytest.mark.parametrize("data", [b"", b"\x01", bytes(11)])
def test_a_read_that_is_answered_with_another_length_is_no_answer(data):
    with pytest.raises(MasterSilent, match=f"{len(data)} bytes"):
        Master(data=data).client.read(0, 10)


@pytest.mark.parametrize(
    ("result", "offset", "name", "at"),
    [
        (Result.OUT_OF_RANGE, 4, "OUT_OF_RANGE", 4),
        (Result.OUT_OF_BOUNDS, 0, "OUT_OF_BOUNDS", 0),
        (Result.NOT_NOW, NO_OFFSET, "NOT_NOW", None),
        (Result.NOTHING_STORED, NO_OFFSET, "NOTHING_STORED", None),
        (99, NO_OFFSET, "result 99", None),
    ],
)
def test_a_refusal_tells_the_request_the_result_and_the_field(result, offset, name, at):
    master = Master(result=result, offset=offset)
    with pytest.raises(MasterRefused) as refused:
        master.client.write(0, b"\0")
    assert (refused.value.request, refused.value.result, refused.value.offset) == ("WRITE", name, at)
    assert len(master.frames) == 1, "a refusal is an answer: it is not asked again"


def test_a_silent_master_is_asked_three_times_with_the_same_bytes():
    master = Master(is_silent=True)
    with pytest.raises(MasterSilent, match=f"IDENTREQUEST after {TRIES} tries"):
        master.client.request(IdentRequest())
    assert len(master.frames) == TRIES
    assert len({(frame.sequence, frame.body) for frame in master.frames}) == 1


def test_after_silence_the_next_request_is_answered():
    master = Master(is_silent=True)
    with pytest.raises(MasterSilent):
        master.client.store()
    master.is_silent = False
    master.client.store()
    assert len(master.frames) == TRIES + 1


def test_a_request_that_does_not_fit_leaves_the_line_free():
    master = Master()
    with pytest.raises(EncodeError):
        master.client.write(419, b"ab")
    assert master.frames == []
    master.client.identify()
    assert len(master.frames) == 1


def test_a_port_that_is_lost_while_asking_leaves_the_line_free():
    master = Master()
    master.is_unplugged = True
    with pytest.raises(LinkLost):
        master.client.identify()
    master.is_unplugged = False
    master.client.identify()
    assert len(master.frames) == 1


def test_a_reply_that_nobody_waits_for_is_dropped():
    master = Master()
    master.client.on_reply(Reply(MessageType.STORE, 3, Result.DONE))
    master.client.identify()
    assert [frame.type for frame in master.frames] == [MessageType.IDENT]


def test_time_in_which_a_reply_lies_unread_is_not_counted_against_the_master():
    clock, frames, looks = FakeClock(), [], []

    def send(raw):
        frames.extend(FrameDecoder().feed(raw))
        clock.advance(3.0)  # the reply came at once, and waits behind three seconds of telemetry

    def unread_since_ns():
        looks.append(clock.monotonic_ns())
        if len(looks) < 5:
            return round(1_000.59e9)
        client.on_reply(Reply(frames[0].type, frames[0].sequence, Result.DONE, NO_OFFSET, b""))
        return None

    client = MasterClient(send, clock, unread_since_ns=unread_since_ns)
    client.write(4, b"\x1c\xa2")
    assert len(frames) == 1


def test_a_service_that_reads_nothing_at_all_does_not_wait_for_ever():
    clock = FakeClock()

    def unread_since_ns():
        clock.advance(1.0)
        return round(1_000e9)

    with pytest.raises(MasterSilent):
        MasterClient(lambda raw: None, clock, unread_since_ns=unread_since_ns).identify()
