"""Requests over a line that answers late, not at all, or with something else."""

import queue
import threading

import pytest

from app.errors import LinkLost, MasterRefused, MasterSilent, NotNow
from app.sources.master.client import MAX_WAITING, MasterClient
from firmware_protocol.framing import FrameDecoder
from firmware_protocol.messages import MessageType, Reply, Result
from tests.fake_clock import FakeClock


class Line:
    """Keeps what was sent; `answer` gives the replies to one request. Without one, time passes until the next try."""

    def __init__(self, answer=lambda frame: [], *, silence_s=10.0):
        self.clock = FakeClock()
        self.silence_s = silence_s
        self.frames = []
        self.sent = threading.Semaphore(0)
        self._answer = answer
        self._decoder = FrameDecoder()
        self.client = MasterClient(self.send, self.clock)

    def send(self, data: bytes) -> None:
        for frame in self._decoder.feed(data):
            self.frames.append(frame)
            replies = self._answer(frame)
            if not replies:
                self.clock.advance(self.silence_s)
            for reply in replies:
                threading.Thread(target=self.client.on_reply, args=(reply,)).start()
        self.sent.release()


def done(frame, data=b""):
    return Reply(frame.type, frame.sequence, Result.DONE, data=data)


def test_long_reads_are_put_together():
    def answer(frame):
        offset, length = frame.body[0] | frame.body[1] << 8, frame.body[2] | frame.body[3] << 8
        return [done(frame, bytes((offset + i) % 251 for i in range(length)))]

    assert Line(answer).client.read(100, 1500) == bytes((100 + i) % 251 for i in range(1500))


def test_a_lost_reply_is_asked_for_again_with_the_same_bytes():
    line = Line()
    line._answer = lambda frame: [done(frame)] if len(line.frames) == 2 else []
    line.client.store()
    assert line.frames[0] == line.frames[1]


def test_replies_to_others_are_not_taken():
    line = Line(lambda frame: [Reply(MessageType.READ, frame.sequence ^ 1, Result.DONE, data=b"wrong"), done(frame)])
    line.client.store()


def test_silence_and_refusal_are_told_apart():
    with pytest.raises(MasterSilent):
        Line().client.store()
    with pytest.raises(MasterRefused, match="NOT_NOW"):
        Line(lambda frame: [Reply(frame.type, frame.sequence, Result.NOT_NOW)]).client.store()


def test_a_silent_master_takes_only_so_many_threads():
    line = Line(silence_s=0.0)
    outcomes = queue.SimpleQueue()

    def ask():
        try:
            line.client.store()
        except (MasterSilent, NotNow, LinkLost) as error:
            outcomes.put(type(error))

    threads = [threading.Thread(target=ask) for _ in range(MAX_WAITING + 5)]
    for thread in threads:
        thread.start()
    assert {outcomes.get(timeout=10) for _ in range(4)} == {NotNow}
    line.client.close()
    assert {outcomes.get(timeout=10) for _ in range(1 + MAX_WAITING)} == {LinkLost}


def test_closing_lets_whoever_waits_go():
    line = Line(silence_s=0.0)
    outcome = []

    def ask():
        try:
            line.client.store()
        except LinkLost as error:
            outcome.append(error)

    thread = threading.Thread(target=ask)
    thread.start()
    assert line.sent.acquire(timeout=5)
    line.client.close()
    thread.join(5)
    assert outcome
    with pytest.raises(LinkLost):
        line.client.store()
    assert len(line.frames) == 1
