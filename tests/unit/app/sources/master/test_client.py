"""What each request puts on the line, and what its answer, a late one or none at all means for the one who asked."""

import queue
import threading
from itertools import pairwise

import pytest

from app.errors import LinkLost, MasterRefused, MasterSilent, NotNow
from app.sources.master.client import MAX_WAITING, TRIES, MasterClient
from firmware_protocol.errors import EncodeError
from firmware_protocol.framing import BadFrame, BadReason, Frame, FrameDecoder
from firmware_protocol.messages import (
    EEPROM_READ_BASE,
    MAX_READ,
    NO_OFFSET,
    Command,
    CommandId,
    Ident,
    IdentRequest,
    Load,
    MessageType,
    Read,
    Reply,
    Result,
    Store,
    Write,
)
from tests.fake_clock import FakeClock
from tests.host_requests import decode_request


def frame_with(reply: Reply) -> Frame:
    return Frame(MessageType.REPLY, 0, 0, reply.to_body(), b"")


def done(frame: Frame) -> list[Reply]:
    """What a master that does everything answers."""
    request = decode_request(frame)
    data = Ident((1, 2, 3), boots=7).to_bytes() if isinstance(request, IdentRequest) else b""
    if isinstance(request, Read):
        data = bytes((request.offset + i) % 251 for i in range(request.length))
    return [Reply(frame.type, frame.sequence, Result.DONE, data=data)]


class Line:
    """Keeps what was sent; `answer` gives the replies to a request, from another thread or before `send` returns.

    Without a reply, `silence_s` pass until the next try.
    """

    def __init__(self, answer=done, *, silence_s=10.0, is_at_once=False):
        self.clock = FakeClock()
        self.silence_s, self.is_at_once, self.is_unplugged = silence_s, is_at_once, False
        self.answer = answer
        self.frames: list[Frame] = []
        self.sent = threading.Semaphore(0)
        self._decoder = FrameDecoder()
        self.client = MasterClient(self.send, self.clock)

    @property
    def requests(self):
        return [decode_request(frame) for frame in self.frames]

    def send(self, data: bytes) -> None:
        if self.is_unplugged:
            raise LinkLost("unplugged")
        for frame in self._decoder.feed(data):
            self.frames.append(frame)
            replies = self.answer(frame)
            if not replies:
                self.clock.advance(self.silence_s)
            for reply in replies:
                if self.is_at_once:
                    self.client.on_frame(frame_with(reply))
                else:
                    threading.Thread(target=self.client.on_frame, args=(frame_with(reply),)).start()
        self.sent.release()


@pytest.fixture(params=[True, False], ids=["at once", "from another thread"])
def line(request):
    return Line(is_at_once=request.param)


def test_each_request_has_its_frame_and_a_number_of_its_own(line):
    requests = [IdentRequest(), Write(4, b"\x1c\xa2"), Store(), Load(), Command(CommandId.SET_SOC, 9991)]
    for request in requests:
        line.client.request(request)
    assert line.requests == requests
    for _ in range(300):
        line.client.identify()
    sequences = [frame.sequence for frame in line.frames]
    assert all((b - a) % 256 == 1 for a, b in pairwise(sequences))
    assert {frame.uptime_ms for frame in line.frames} == {0}


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
def test_a_read_takes_as_many_requests_as_it_needs_and_is_put_together(offset, length, parts):
    line = Line()
    assert line.client.read(offset, length) == bytes((offset + i) % 251 for i in range(length))
    assert line.requests == [Read(*part) for part in parts]


@pytest.mark.parametrize("data", [b"", b"\x01", bytes(11)])
def test_a_read_that_is_answered_with_another_length_is_no_answer(data):
    line = Line(lambda frame: [Reply(frame.type, frame.sequence, Result.DONE, data=data)])
    with pytest.raises(MasterSilent, match=f"{len(data)} bytes"):
        line.client.read(0, 10)


def test_the_identity_is_the_one_of_the_last_answer():
    line = Line()
    assert line.client.identity is None
    identity = line.client.identify()
    assert (identity.firmware, identity.boots, identity.is_compatible) == ("1.2.3", 7, True)
    line.answer = lambda frame: [Reply(frame.type, frame.sequence, Result.DONE, data=b"\1")]
    with pytest.raises(MasterSilent, match="invalid identification"):
        line.client.identify()
    assert line.client.identity == identity


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
def test_a_refusal_names_the_request_the_result_and_the_field_and_is_not_asked_again(result, offset, name, at):
    line = Line(lambda frame: [Reply(frame.type, frame.sequence, result, offset)])
    with pytest.raises(MasterRefused) as refused:
        line.client.request(Write(0, b"\0"))
    assert (refused.value.request, refused.value.result, refused.value.offset) == ("WRITE", name, at)
    assert len(line.frames) == 1


def test_a_silent_master_is_asked_three_times_with_the_same_bytes_and_the_next_request_is_answered():
    line = Line(lambda frame: [])
    with pytest.raises(MasterSilent, match=f"IDENTREQUEST after {TRIES} tries"):
        line.client.request(IdentRequest())
    assert len(line.frames) == TRIES
    assert len({(frame.sequence, frame.body) for frame in line.frames}) == 1
    line.answer = done
    line.client.request(Store())
    assert len(line.frames) == TRIES + 1


@pytest.mark.parametrize(
    ("request_", "silence_s", "tries"), [(Read(0, 1), 0.7, 2), (Store(), 3.1, 2), (Load(), 3.1, 2), (Store(), 0.7, 1)]
)
def test_a_lost_reply_is_asked_for_again_after_its_time(request_, silence_s, tries):
    line = Line(silence_s=silence_s)

    def answer(frame):
        if len(line.frames) == tries:
            line.clock.advance(silence_s if tries == 1 else 0.0)
            return done(frame)
        return []

    line.answer = answer
    line.client.request(request_)
    assert len(line.frames) == tries
    assert all(frame == line.frames[0] for frame in line.frames)


def test_a_reply_to_something_else_is_not_asked_for():
    line = Line()
    asked = []

    def answer(frame):
        for stray in (
            Reply(MessageType.READ, frame.sequence, Result.DONE),
            Reply(frame.type, frame.sequence ^ 1, Result.DONE),
        ):
            asked.append(line.client.on_frame(frame_with(stray)))
        return done(frame)

    line.answer = answer
    line.client.request(Store())
    again = frame_with(*done(line.frames[0]))
    assert [*asked, line.client.on_frame(again)] == [False, False, False], "nor is the second copy of an answer"
    assert not line.client.on_frame(Frame(MessageType.REPLY, 0, 0, b"", b"")), "nor one that means nothing"
    others = [BadFrame(BadReason.CRC, b"\1"), Frame(MessageType.DATA, 0, 0, b"", b"")]
    assert [line.client.on_frame(frame) for frame in others] == [True, True], "what is no reply concerns nobody"


def test_a_request_is_not_sent_again_over_another_connection(line):
    line.client.identify()

    def lose(frame):
        line.client.on_lost()
        return []

    line.answer, line.silence_s = lose, 1.0
    with pytest.raises(LinkLost, match="lost before the reply to WRITE"):
        line.client.request(Write(0, b"\0"))
    assert line.client.identity is None
    assert len(line.frames) == 2
    line.answer = done
    line.client.request(Store())


@pytest.mark.parametrize("is_unplugged", [True, False], ids=["the port is lost", "the request does not fit"])
def test_a_request_that_was_not_sent_leaves_the_line_free(is_unplugged):
    line = Line()
    line.is_unplugged = is_unplugged
    with pytest.raises(LinkLost if is_unplugged else EncodeError):
        line.client.request(Store() if is_unplugged else Write(419, b"ab"))
    assert line.frames == []
    line.is_unplugged = False
    line.client.identify()
    assert len(line.frames) == 1


def test_a_silent_master_takes_only_so_many_threads_and_closing_ends_them():
    line = Line(lambda frame: [], silence_s=0.0)
    outcomes = queue.SimpleQueue()

    def ask():
        try:
            line.client.request(Store())
        except (MasterSilent, NotNow, LinkLost) as error:
            outcomes.put(type(error))

    threads = [threading.Thread(target=ask) for _ in range(MAX_WAITING + 5)]
    for thread in threads:
        thread.start()
    assert {outcomes.get(timeout=10) for _ in range(4)} == {NotNow}
    assert line.sent.acquire(timeout=5)
    line.client.close()
    assert {outcomes.get(timeout=10) for _ in range(1 + MAX_WAITING)} == {LinkLost}
    with pytest.raises(LinkLost):
        line.client.request(Store())
    assert len(line.frames) == 1
