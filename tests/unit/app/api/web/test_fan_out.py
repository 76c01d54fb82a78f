"""Who gets which snapshot when: on a loop whose clock the test turns."""

from contextlib import ExitStack

import pytest
from hypothesis import given
from hypothesis import strategies as st
from starlette.websockets import WebSocketDisconnect

from app.api.web.fan_out import WITHHELD_S, FanOut, Reader
from app.live.hub import Hub


class Loop:
    def __init__(self):
        self.now_s = 100.0
        self.waiting = []

    def time(self):
        return self.now_s

    def call_later(self, delay, callback):
        timer = Timer(self.now_s + delay, callback)
        self.waiting.append(timer)
        return timer

    def create_task(self, work):
        with pytest.raises(StopIteration):
            work.send(None)  # it waits for nobody

    def turn(self, seconds):
        until = self.now_s + seconds
        while due := sorted((t for t in self.waiting if t.at_s <= until and not t.is_cancelled), key=lambda t: t.at_s):
            self.now_s = due[0].at_s
            self.waiting.remove(due[0])
            due[0].callback()
        self.now_s = until


class Timer:
    def __init__(self, at_s, callback):
        self.at_s, self.callback, self.is_cancelled = at_s, callback, False

    def cancel(self):
        self.is_cancelled = True


class Stream:
    """The connection of a reader that takes everything until it is behind."""

    def __init__(self):
        self.is_behind, self.on_drained, self.texts = False, None, []
        self.reader = Reader(self.send, self, None, "10.0.0.1", 100.0)

    async def send(self, text):
        self.texts.append(text)

    @property
    def seen(self):
        return [int(text) for text in self.texts]

    def wake(self):
        self.is_behind = False
        self.on_drained()


class Encoder:
    """A snapshot is a number here."""

    def __init__(self):
        self.known = {}

    def encode(self, snapshot):
        return self.known.setdefault(snapshot, b"%d" % snapshot)


class Bench:
    def __init__(self):
        self.hub, self.loop, self.encoder = Hub(), Loop(), Encoder()
        self.fan_out = FanOut(self.hub, self.encoder, lambda: self.loop)
        self.open = ExitStack()

    def join(self, rate=None):
        stream = Stream()
        self.open.enter_context(self.fan_out.joined(stream.reader, rate))
        return stream

    def publish(self, value):
        self.hub.publish_threadsafe(value)
        self.hub._publish_latest()


@pytest.fixture
def bench():
    return Bench()


def test_a_new_reader_gets_the_latest_at_once(bench):
    bench.publish(1)
    bench.publish(2)
    assert bench.join().seen == [2]
    assert bench.join(rate=1).seen == [2]
    assert bench.join(rate=1).seen == [2]


def test_all_get_the_same_text_and_it_is_made_once(bench):
    readers = [bench.join() for _ in range(5)]
    bench.publish(7)
    assert len({id(reader.texts[0]) for reader in readers}) == 1


def test_one_that_is_closed_keeps_no_other_from_its_text(bench):
    async def fail(text):
        raise WebSocketDisconnect

    bench.join().reader.send = fail
    last = bench.join()
    bench.publish(7)
    assert last.seen == [7]


def test_readers_are_listed_the_longest_first(bench):
    streams = [bench.join(rate=rate) for rate in (5, None, 5)]
    assert bench.fan_out.readers == [each.reader for each in streams]
    bench.open.close()
    assert bench.fan_out.readers == []


def test_a_slow_reader_misses_values_and_others_do_not(bench):
    slow, fast = bench.join(), bench.join()
    slow.is_behind = True
    for value in range(5):
        bench.publish(value)
    assert (slow.seen, fast.seen) == ([], [0, 1, 2, 3, 4])
    slow.wake()
    assert slow.seen == [4]
    slow.wake()  # nothing was missed since
    assert slow.seen == [4]


def test_the_same_value_is_not_sent_twice(bench):
    reader = bench.join()
    bench.publish(1)
    bench.publish(1)
    assert reader.seen == [1]


def test_readers_of_one_rate_get_the_same_values(bench):
    first = bench.join(rate=10)
    second = bench.join(rate=10)
    for value in range(1, 26):
        bench.publish(value)
        bench.loop.turn(0.04)
    assert first.seen == second.seen
    assert len(first.seen) == 10


def test_what_came_too_early_is_sent_where_nothing_newer_comes(bench):
    reader = bench.join(rate=2)
    bench.publish(1)
    bench.publish(2)
    assert reader.seen == [1]
    bench.loop.turn(0.5 + WITHHELD_S)
    assert reader.seen == [1, 2]
    bench.loop.turn(10)
    assert reader.seen == [1, 2]


def test_who_left_gets_nothing(bench):
    stays = bench.join(rate=5)
    leaves = Stream()
    with bench.fan_out.joined(leaves.reader, 5):
        bench.publish(1)
    with bench.fan_out.joined(Stream().reader, 3):
        bench.publish(2)
        bench.publish(3)
    bench.loop.turn(10)
    assert leaves.seen == [1]
    assert leaves.on_drained is None
    assert stays.seen[-1] == 3


@given(st.floats(0.5, 50), st.lists(st.floats(0.001, 3), min_size=1, max_size=60))
def test_no_rate_is_exceeded_and_the_newest_always_arrives(rate, pauses_s):
    bench = Bench()
    reader, at_s = bench.join(rate=rate), []

    async def noted_send(text):
        at_s.append(bench.loop.now_s)
        reader.texts.append(text)

    reader.reader.send = noted_send
    for value, pause_s in enumerate(pauses_s):
        bench.publish(value)
        bench.loop.turn(pause_s)
    bench.loop.turn(1 / rate + WITHHELD_S)
    assert reader.seen[-1] == len(pauses_s) - 1
    for first in range(len(at_s)):
        for last in range(first, len(at_s)):
            assert last - first <= (at_s[last] - at_s[first]) * rate + 2
