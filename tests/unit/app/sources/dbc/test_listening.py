"""Frames received on a bus for some time: what is kept, when it ends, and the error where the bus fails."""

import threading
import time
from collections.abc import Callable, Iterator
from uuid import uuid4

import can
import pytest

from app.errors import ConfigError, LinkLost
from app.sources.dbc import listening
from app.sources.dbc.listening import BusListener, bus_frames
from firmware_protocol.memory_map import CAN_ID_EXTENDED

MOST = 3  # frames that are kept


@pytest.fixture
def bus(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[can.BusABC, BusListener]]:
    """Another node, and who listens to it."""
    monkeypatch.setattr(listening, "_MOST_FRAMES", MOST)
    channel = uuid4().hex
    with can.Bus(channel, interface="virtual") as node:
        listener = BusListener(f"virtual:{channel}")
        yield node, listener
        listener.close()


def until(is_so: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + 10
    while not is_so():
        assert time.monotonic() < deadline_s


def frame(can_id: int, data: bytes = b"\x01", **kind: bool) -> can.Message:
    return can.Message(arbitration_id=can_id, data=data, **{"is_extended_id": False, **kind})


def test_frames_are_kept_in_their_order_with_the_mark_of_29_bits(bus) -> None:
    node, listener = bus
    node.send(frame(0x123, b"\x01\x02"))
    node.send(frame(0x123, b"", is_extended_id=True))
    node.send(frame(0x400, bytes(64), is_fd=True))
    until(lambda: len(listener.frames()) == 3)
    received = listener.frames()
    assert received.can_id.tolist() == [0x123, 0x123 | CAN_ID_EXTENDED, 0x400]
    assert received.length.tolist() == [2, 0, 64]
    assert received.t_ns.tolist() == sorted(received.t_ns.tolist())


def test_errors_of_the_bus_and_requests_are_no_frames(bus) -> None:
    node, listener = bus
    node.send(frame(0x4, bytes(8), is_error_frame=True))
    node.send(can.Message(arbitration_id=0x10, is_extended_id=False, is_remote_frame=True, dlc=8))
    node.send(frame(0x11))
    until(lambda: len(listener.frames()) > 0)
    assert listener.frames().can_id.tolist() == [0x11]


def test_of_more_frames_than_are_kept_the_newest_stay(bus) -> None:
    node, listener = bus
    for can_id in range(1, 6):
        node.send(frame(can_id))
    until(lambda: 5 in listener.frames().can_id)
    assert listener.frames().can_id.tolist() == [3, 4, 5]


@pytest.mark.parametrize(
    ("url", "error", "why"),
    [("can0", ConfigError, "INTERFACE:CHANNEL"), ("socketcan:no_such_bus", LinkLost, "socketcan:no_such_bus")],
)
def test_what_is_no_bus_or_cannot_be_opened_is_refused_with_its_reason(url: str, error: type, why: str) -> None:
    with pytest.raises(error, match=why):
        BusListener(url)


class _Pulled:
    """An adapter that tells one frame and is gone."""

    def __init__(self) -> None:
        self.told = 0
        self.closed = threading.Event()

    def recv(self, timeout: float) -> can.Message:
        self.told += 1
        if self.told > 1:
            raise OSError("No such device")
        return frame(0x7)

    def shutdown(self) -> None:
        self.closed.set()


def test_an_adapter_that_is_pulled_ends_the_wait_and_what_was_heard_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    adapter = _Pulled()
    monkeypatch.setattr(listening, "open_bus", lambda arguments: adapter)
    listener = BusListener("virtual:pulled")
    received = listener.wait(600.0)  # ends with the adapter
    assert received.can_id.tolist() == [0x7]
    assert "No such device" in str(listener.lost)
    listener.close()
    assert adapter.closed.is_set()


def test_what_was_heard_until_ctrl_c_is_returned_and_the_bus_given_free(monkeypatch: pytest.MonkeyPatch) -> None:
    adapter = _Pulled()
    monkeypatch.setattr(listening, "open_bus", lambda arguments: adapter)

    def interrupted(listener: BusListener, duration_s: float) -> None:
        until(lambda: len(listener.frames()) > 0)
        raise KeyboardInterrupt

    monkeypatch.setattr(BusListener, "wait", interrupted)
    assert bus_frames("virtual:any", 600.0).can_id.tolist() == [0x7]
    assert adapter.closed.is_set()
