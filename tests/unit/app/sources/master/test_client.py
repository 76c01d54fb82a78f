"""Requests over a line that answers late, not at all, or with something else."""

import threading

import pytest

from app.errors import LinkLost, MasterRefused, MasterSilent, NotNow
from app.sources.master.client import MAX_WAITING, MasterClient
from firmware_protocol.framing import FrameDecoder
from firmware_protocol.messages import MessageType, Reply, Result


class Line:
    """Keeps what was sent; `answer` gives the replies to one request."""

    def __init__(self, answer=lambda frame: []):
        self.frames = []
        self.sent = threading.Semaphore(0)
        self._answer = answer
        self._decoder = FrameDecoder()
        self.client = MasterClient(self.send)

    def send(self, data: bytes) -> None:
        for frame in self._decoder.feed(data):
            self.frames.append(frame)
            for reply in self._answer(frame):
                threading.Thread(target=self.client.on_reply, args=(reply,)).start()
        self.sent.release()


def done(frame, data=b""):
    return Reply(frame.type, frame.sequence, Result.DONE, data=data)


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr("firmware_protocol.exchange.TIMEOUT_S", 0.05)
    monkeypatch.setattr("firmware_protocol.exchange.STORE_TIMEOUT_S", 0.05)


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
    line = Line()
    outcomes = []

    def ask():
        try:
            line.client.store()
        except (MasterSilent, NotNow, LinkLost) as error:
            outcomes.append(type(error))

    threads = [threading.Thread(target=ask) for _ in range(MAX_WAITING + 5)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(10)
    assert len(outcomes) == len(threads)
    assert outcomes.count(NotNow) == 4


def test_closing_lets_whoever_waits_go(monkeypatch):
    monkeypatch.setattr("firmware_protocol.exchange.STORE_TIMEOUT_S", 60.0)
    line = Line()
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
