"""Lists onto the bus: order, counts, stopping, a bus that refuses."""

import threading

import pytest

from app.clock import Clock
from app.errors import LinkLost, NotNow
from app.sources.links.can_sender import CanSender, Outgoing


class Bus:
    def __init__(self, wanted: int = 0) -> None:
        self.frames: list[tuple[int, bytes]] = []
        self.wanted = wanted
        self.reached = threading.Event()

    def send(self, can_id: int, data: bytes) -> None:
        self.frames.append((can_id, data))
        if len(self.frames) >= self.wanted:
            self.reached.set()


def sending(wanted: int = 0) -> tuple[Bus, CanSender]:
    bus = Bus(wanted)
    return bus, CanSender(bus.send, Clock())


def ended(sender: CanSender):
    sender._thread.join(5)
    return sender.status


def test_single_frames_leave_at_once_and_in_order():
    bus, sender = sending()
    assert sender.once([Outgoing(1, b"a"), Outgoing(2, b"b")]) == 2
    assert bus.frames == [(1, b"a"), (2, b"b")]


def test_a_list_sends_each_as_often_as_it_says():
    bus, sender = sending()
    sender.start_list([Outgoing(1, b"", 0.002, 5), Outgoing(2, b"", 0.005, 2), Outgoing(3, b"")], "ada")
    status = ended(sender)
    assert (status.sent, status.total, status.error) == (8, 8, None)
    assert [sum(1 for can_id, _ in bus.frames if can_id == n) for n in (1, 2, 3)] == [5, 2, 1]


def test_one_without_an_end_goes_on_until_it_is_stopped():
    bus, sender = sending(5)
    sender.start_list([Outgoing(1, b"", 0.001)], "ada")
    assert bus.reached.wait(5)
    with pytest.raises(NotNow, match="ada"):
        sender.start_list([Outgoing(2, b"", 0.001)], "bob")
    status = sender.stop()
    assert status.sent >= 5
    assert status.total is None
    assert not sender.is_busy


def test_recorded_frames_keep_their_order():
    bus, sender = sending()
    sender.start_frames("session x", iter([(0.0, 7, b"1"), (0.003, 8, b"2"), (0.006, 7, b"3")]), 3, "ada")
    assert ended(sender).sent == 3
    assert bus.frames == [(7, b"1"), (8, b"2"), (7, b"3")]


def test_a_bus_that_refuses_ends_the_list_and_is_told():
    def refuse(can_id, data):
        raise LinkLost("the CAN bus is not connected")

    sender = CanSender(refuse, Clock())
    sender.start_list([Outgoing(1, b"", 0.001)], "ada")
    assert ended(sender).error == LinkLost("the CAN bus is not connected").message
    with pytest.raises(LinkLost):
        sender.once([Outgoing(1, b"")])


def test_a_sender_is_idle_before_and_between_its_lists():
    bus, sender = sending()
    assert (sender.is_busy, sender.status.what, sender.status.sent) == (False, None, 0)
    assert sender.stop() == sender.status
    for who in ("ada", "bob"):
        sender.start_list([Outgoing(1, who.encode())], who)
        assert (ended(sender).who, ended(sender).sent) == (who, 1)
    assert bus.frames == [(1, b"ada"), (1, b"bob")]


def test_stopping_waits_for_no_frame_that_is_due_later():
    bus, sender = sending(1)
    sender.start_frames("session x", iter([(0.0, 7, b"1"), (3600.0, 8, b"2")]), 2, "ada")
    assert bus.reached.wait(5)
    status = sender.stop()
    assert (status.sent, status.total, status.error) == (1, 2, None)
    assert not sender.is_busy
