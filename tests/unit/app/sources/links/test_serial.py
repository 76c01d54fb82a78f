"""The link on real pseudo-terminals: unplugged at any moment, opened again, and nothing left behind."""

import contextlib
import os
import random
import termios
import threading
import time
import tty
from pathlib import Path
from types import SimpleNamespace

import pytest

from app.clock import Clock
from app.errors import LinkLost
from app.sources.items import LinkChange, SerialItem, UnframedBytes
from app.sources.links.serial import Backoff, SerialLink
from app.words import Message, render
from firmware_protocol.framing import Frame, encode_frame

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals")


class Seen:
    """What the link delivered; `wait` until a condition holds."""

    def __init__(self):
        self.items = []
        self.changed = threading.Condition()

    def __call__(self, item):
        with self.changed:
            self.items.append(item)
            self.changed.notify_all()

    def wait(self, condition, seconds=10):
        with self.changed:
            assert self.changed.wait_for(lambda: condition(self.items), seconds), self.items[-5:]


def changes(items, state):
    return [item for item in items if isinstance(item, LinkChange) and item.state == state]


def open_descriptors() -> int:
    folder = Path("/proc/self/fd")
    return len(list(folder.iterdir())) if folder.is_dir() else 0


class Plug:
    """A port that can be plugged in and out under one name."""

    def __init__(self, path: Path):
        self.path = path
        self.ours = self.theirs = -1

    def insert(self):
        self.ours, self.theirs = os.openpty()
        tty.setraw(self.theirs)
        self.path.symlink_to(os.ttyname(self.theirs))
        os.close(self.theirs)

    def remove(self):
        self.path.unlink(missing_ok=True)
        with contextlib.suppress(OSError):
            os.close(self.ours)


@pytest.fixture
def plug(tmp_path):
    made = Plug(tmp_path / "port")
    yield made
    made.remove()


def quick() -> Backoff:
    """Tries again after five milliseconds at most."""
    return Backoff(0.005, 0.005)


@pytest.fixture
def seen():
    return Seen()


@pytest.fixture
def link(plug, seen):
    made = SerialLink(str(plug.path), seen, Clock(), quick())
    made.start()
    yield made
    made.stop()


def test_fifty_times_unplugged_leaves_nothing_open(plug, seen, link, master):
    rng = random.Random(1)
    descriptors = open_descriptors()
    threads = threading.active_count()
    for cycle in range(1, 51):
        plug.insert()
        raw = b"\0" + master.frame().frame.raw + b"\0"
        seen.wait(lambda items, n=cycle: len(changes(items, "open")) == n)
        before = sum(isinstance(item, SerialItem) for item in seen.items)
        if cycle % 5 == 0:
            with contextlib.suppress(OSError):
                os.write(plug.ours, raw[: rng.randrange(len(raw))])  # in the middle of a frame
        else:
            os.write(plug.ours, raw)
            seen.wait(lambda items, n=before: sum(isinstance(item, SerialItem) for item in items) > n)
        plug.remove()
        seen.wait(lambda items: getattr(items[-1], "state", None) == "lost")
    assert threading.active_count() == threads
    link.stop()
    assert open_descriptors() <= descriptors


def test_it_asks_for_the_stream_and_says_goodbye(plug, seen, link):
    plug.insert()
    seen.wait(lambda items: changes(items, "open"))
    assert os.read(plug.ours, 1) == b"x"
    link.stop()
    assert os.read(plug.ours, 1) == b"y"


def test_what_arrives_while_the_process_stands_still_has_waited_as_long(plug, seen, master, monkeypatch):
    stands_ns = 1_500_000_000

    class Standing(Clock):
        stood_ns = 0

        def monotonic_ns(self):
            return super().monotonic_ns() + self.stood_ns

    clock, frames = Standing(), [b"\0" + master.frame().frame.raw + b"\0" for _ in range(2)]

    def read(descriptor, size):
        data = os.read(descriptor, size)
        if not clock.stood_ns:
            os.write(plug.ours, frames[1])
            clock.stood_ns = stands_ns
        return data

    monkeypatch.setattr("app.sources.links.serial.os", SimpleNamespace(name="posix", read=read))
    plug.insert()
    link = SerialLink(str(plug.path), seen, clock, quick())
    link.start()
    try:
        seen.wait(lambda items: changes(items, "open"))
        os.write(plug.ours, frames[0])
        seen.wait(lambda items: sum(isinstance(item, SerialItem) for item in items) == 2)
    finally:
        link.stop()
    assert [item for item in seen.items if isinstance(item, SerialItem)][1].waited_max_ns >= stands_ns


@pytest.mark.parametrize("data", [b"cell 1: 3.701 V\r\n", b"\x00\xe7\x00\x81\x00\x3c\xf1"], ids=["ASCII", "parity"])
def test_bytes_that_are_no_frames_are_handed_on_with_the_last_of_them(plug, seen, master, monkeypatch, data):
    monkeypatch.setattr("app.sources.links.serial.UNFRAMED_S", 0.05)
    plug.insert()
    link = SerialLink(str(plug.path), seen, Clock(), quick())
    link.start()

    def unframed(items):
        return [item for item in items if isinstance(item, UnframedBytes)]

    try:
        seen.wait(lambda items: changes(items, "open"))
        written = 0
        while len(unframed(seen.items)) < 3:
            written += os.write(plug.ours, data)
            time.sleep(0.01)
        found = unframed(seen.items)
        assert found[-1].last in data * 64
        assert len(found[-1].last) <= 64
        bad = sum(len(item.frame.raw) for item in seen.items if isinstance(item, SerialItem))
        assert 0 < sum(item.count for item in found) + bad <= written
        os.write(plug.ours, encode_frame(1, 0, 0, b"") * 2)
        seen.wait(lambda items: any(isinstance(i, SerialItem) and isinstance(i.frame, Frame) for i in items))
        before = len(unframed(seen.items))
        os.write(plug.ours, encode_frame(1, 1, 0, b""))
        seen.wait(lambda items: sum(isinstance(i, SerialItem) and isinstance(i.frame, Frame) for i in items) > 1)
        assert len(unframed(seen.items)) == before
    finally:
        link.stop()


def test_writing_to_a_port_that_is_gone_is_said(plug, seen, link):
    with pytest.raises(LinkLost):
        link.write(b"x")


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (FileNotFoundError(2, "No such file or directory"), "unplugged"),
        (PermissionError(13, "Permission denied"), "dialout"),
        (OSError("Could not exclusively lock port"), "another program"),
        (ConnectionRefusedError(111, "Connection refused"), "other end"),
        (OSError(5, "Input/output error"), "unplugged"),
        (termios.error(5, "Input/output error"), "unplugged"),  # a driver raises errors of its own
        (OSError("the adapter is on fire"), "the adapter is on fire"),
        (TimeoutError(), "TimeoutError"),
    ],
    ids=lambda value: value if isinstance(value, str) else type(value).__name__,
)
def test_why_a_port_does_not_open_is_told_for_a_pit_crew_and_it_is_tried_again(seen, monkeypatch, error, words):
    def refuse(*_, **__):
        raise error

    link = SerialLink("/dev/x", seen, Clock(), quick())
    monkeypatch.setattr("app.sources.links.serial.serial.serial_for_url", refuse)
    link.start()
    seen.wait(lambda items: len(changes(items, "lost")) >= 3)
    link.stop()
    assert words in render(changes(seen.items, "lost")[0].error)
    assert changes(seen.items, "open") == []


def test_a_port_is_read_by_one_alone(plug, seen, link):
    plug.insert()
    seen.wait(lambda items: changes(items, "open"))
    other_seen = Seen()
    other = SerialLink(str(plug.path), other_seen, Clock(), quick())
    other.start()
    other_seen.wait(lambda items: changes(items, "lost"))
    other.stop()
    assert changes(other_seen.items, "lost")[0].error == Message("port-in-use")


class Extreme(random.Random):
    """A generator that always gives the same end of its range."""

    def __init__(self, value):
        super().__init__()
        self._value = value

    def random(self):
        return self._value


def waits(backoff, n):
    return [backoff.next_s() for _ in range(n)]


def test_each_failure_doubles_the_wait_up_to_the_cap_and_a_success_starts_again():
    longest = Backoff(0.2, 2.0, Extreme(1.0))
    assert waits(longest, 6) == pytest.approx([0.2, 0.4, 0.8, 1.6, 2.0, 2.0])
    longest.reset()
    assert longest.next_s() == pytest.approx(0.2)
    assert waits(Backoff(0.2, 2.0, Extreme(0.0)), 6) == pytest.approx([0.1, 0.2, 0.4, 0.8, 1.0, 1.0])


def test_two_links_that_were_lost_together_do_not_come_back_together():
    first, second = (waits(Backoff(rng=random.Random(seed)), 50) for seed in (1, 2))
    assert all(a != b for a, b in zip(first, second, strict=True))
    assert 0.1 <= first[0] <= 0.2
    assert all(1.0 <= wait <= 2.0 for wait in first[5:])
