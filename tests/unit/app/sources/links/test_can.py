"""The CAN link on python-can's virtual bus, and its controller: what an adapter does not say stays unknown."""

import queue
import threading
import uuid

import can
import pytest

from app.clock import Clock
from app.errors import LinkLost
from app.sources.items import CanFault, CanItem, LinkChange
from app.sources.links.can import CanLink, ControllerWatch, reported_state
from app.sources.links.can_bus import bit_rate_of
from firmware_protocol.memory_map import CAN_ID_EXTENDED


@pytest.fixture
def bus():
    """Another node, the link, and what the link delivers."""
    channel = uuid.uuid4().hex
    items: queue.Queue = queue.Queue()
    link = CanLink(f"virtual:{channel}", items.put, Clock())
    with can.Bus(interface="virtual", channel=channel) as node:
        link.start()
        while not (isinstance(item := items.get(timeout=5), LinkChange) and item.state == "open"):
            pass
        assert items.get(timeout=5).errors is None, "a virtual bus has no controller that counts"
        yield node, link, items
        link.stop()


def test_a_frame_reaches_the_bus_and_the_sink(bus):
    node, link, items = bus
    link.send(0x18FF50E5 | CAN_ID_EXTENDED, b"\x01\x02")
    received = node.recv(2)
    assert (received.arbitration_id, received.is_extended_id, bytes(received.data)) == (0x18FF50E5, True, b"\x01\x02")
    told = items.get(timeout=2)
    assert isinstance(told, CanItem)
    assert (told.can_id, told.data, told.sent) == (0x18FF50E5 | CAN_ID_EXTENDED, b"\x01\x02", True)


def test_error_frames_are_counted_and_say_the_controllers_state(bus):
    node, _, items = bus
    for can_id, data in ((0x04, b"\x00\x04"), (0x04, b"\x00\x20"), (0x40, b"\x00\x00"), (0x100, b"\x00\x00")):
        node.send(can.Message(arbitration_id=can_id, is_error_frame=True, data=data))
    faults = [items.get(timeout=2) for _ in range(4)]
    assert all(isinstance(fault, CanFault) for fault in faults)
    assert [fault.bus_state for fault in faults] == ["warning", "passive", "off", "active"]
    assert [fault.errors for fault in faults] == [1, 2, 3, 4]


def test_a_frame_of_can_fd_comes_whole_and_requests_carry_nothing_and_are_not_delivered(bus):
    node, _, items = bus
    node.send(can.Message(arbitration_id=0x100, is_extended_id=False, is_remote_frame=True, dlc=8))
    node.send(can.Message(arbitration_id=0x400, is_extended_id=False, is_fd=True, data=bytes(range(64))))
    received = items.get(timeout=2)
    assert (received.can_id, received.data) == (0x400, bytes(range(64)))


@pytest.mark.parametrize(
    ("url", "fd", "opened"),
    [
        ("socketcan:can0", False, None),
        ("socketcan:can0", True, True),
        ("socketcan:can0?fd=false", True, False),
        ("pcan:PCAN_USBBUS1", True, None),  # wants its timing said: by the person who knows it
    ],
)
def test_an_adapter_is_opened_for_can_fd_where_one_flag_does_it_and_nobody_said_otherwise(monkeypatch, url, fd, opened):
    asked: queue.Queue = queue.Queue()
    monkeypatch.setattr(can, "Bus", lambda **arguments: asked.put(arguments) or 1 / 0)
    link = CanLink(url, lambda item: None, Clock(), fd=fd)
    link.start()
    assert asked.get(timeout=5).get("fd") == opened
    link.stop()


class _Adapter:
    """A bus of a driver that fails as it is told to."""

    def __init__(self, failure):
        self.failure, self.closed = failure, threading.Event()

    def recv(self, timeout):
        raise self.failure

    def send(self, message, timeout=None):
        raise self.failure

    def shutdown(self):
        self.closed.set()


def test_an_adapter_that_is_pulled_is_told_with_its_reason_and_given_free(monkeypatch):
    adapter = _Adapter(OSError("No such device"))
    monkeypatch.setattr(can, "Bus", lambda **arguments: adapter)
    items: queue.Queue = queue.Queue()
    link = CanLink("virtual:pulled", items.put, Clock())
    link.start()
    told = []
    while not told or told[-1].state != "lost":
        item = items.get(timeout=5)
        told += [item] if isinstance(item, LinkChange) else []
    assert adapter.closed.wait(5)
    link.stop()
    assert [each.state for each in told] == ["connecting", "open", "lost"]
    assert "No such device" in str(told[-1].error)
    with pytest.raises(LinkLost):
        link.send(1, b"")


def test_a_frame_that_the_bus_refuses_is_told_with_the_drivers_reason_and_not_as_sent(bus, monkeypatch):
    _, link, items = bus
    refuse = _Adapter(can.CanOperationError("buffer full")).send
    monkeypatch.setattr(link._bus, "send", refuse)
    with pytest.raises(LinkLost, match="buffer full"):
        link.send(0x123, b"\x01")
    assert items.empty()


def test_a_link_that_never_started_refuses_and_can_be_stopped():
    link = CanLink("virtual:never", lambda item: None, Clock())
    with pytest.raises(LinkLost):
        link.send(1, b"")
    link.stop()


@pytest.mark.parametrize(
    ("url", "expected"),
    [
        (None, None),
        ("virtual:a", None),
        ("slcan:COM5?bitrate=125000", 125_000),
        ("pcan:X?fd=true&bitrate=1000000", 1_000_000),
        ("pcan:X?bitrate=1000000&data_bitrate=4000000", 1_000_000),
        ("virtual:a?bitrate=fast", None),
        ("virtual:a?bitrate=0", None),
        ("virtual:a?bitrate=true", None),
        ("virtual:bitrate=7", None),
        ("socketcan:can0?fd=true&data_bitrate=2000000", None),
    ],
)
def test_a_bit_rate_is_known_where_the_bus_is_named_with_it(url, expected):
    assert bit_rate_of(url) == expected


def error_frame(can_id, *data):
    return can.Message(arbitration_id=can_id, is_error_frame=True, data=bytes(data))


@pytest.mark.parametrize(
    ("message", "state"),
    [
        (error_frame(0x40), "off"),
        (error_frame(0x04, 0, 0x20), "passive"),
        (error_frame(0x04, 0, 0x10), "passive"),
        (error_frame(0x04, 0, 0x08), "warning"),
        (error_frame(0x04, 0, 0x40), "active"),
        (error_frame(0x100), "active"),
        (error_frame(0x04), None),
        (error_frame(0x88, 0, 0, 4), None),
        (error_frame(0x20), None),
    ],
    ids=["bus-off", "passive tx", "passive rx", "warning", "active", "restarted", "no data", "stuff error", "no ack"],
)
def test_an_error_frame_tells_the_state_or_nothing_of_it(message, state):
    assert reported_state(message) == state


def test_an_error_that_says_nothing_of_the_state_leaves_it():
    watch = ControllerWatch("socketcan")
    assert (watch.errors, watch.state) == (0, None)
    watch.on_error_frame(error_frame(0x04, 0, 0x20))
    watch.on_error_frame(error_frame(0x88, 0, 0, 4))
    assert (watch.errors, watch.state) == (2, "passive")
    watch.on_error_frame(error_frame(0x100))
    assert watch.state == "active"


def test_the_controllers_counters_are_taken_where_the_frame_has_them():
    watch = ControllerWatch("socketcan")
    watch.on_error_frame(error_frame(0x04, 0, 0x08, 0, 0, 0, 0, 3, 97))
    assert (watch.tx_errors, watch.rx_errors) == (None, None)
    watch.on_error_frame(error_frame(0x204, 0, 0x08, 0, 0, 0, 0, 3, 97))
    assert (watch.tx_errors, watch.rx_errors) == (3, 97)


def test_an_adapter_that_passes_no_errors_on_has_an_unknown_number_of_them():
    assert ControllerWatch("slcan").errors is None


def test_error_frames_of_another_form_are_counted_and_not_read():
    watch = ControllerWatch("pcan")
    watch.on_error_frame(error_frame(0x04, 0, 0x30))  # to PCAN, 4 is a stuff error, and this its place in the frame
    assert (watch.errors, watch.state) == (1, None)


class Asked:
    """What can be asked of an adapter."""

    def __init__(self, answer):
        self._answer = answer

    def status(self):
        return self.state

    @property
    def state(self):
        if isinstance(self._answer, Exception):
            raise self._answer
        return self._answer


@pytest.mark.parametrize(
    ("interface", "answer", "state"),
    [
        ("pcan", 0, "active"),
        ("pcan", 0x08, "warning"),
        ("pcan", 0x40000, "passive"),
        ("pcan", 0x40010, "off"),
        ("pcan", OSError("gone"), None),
        ("ixxat", can.BusState.ERROR, "off"),
        ("ixxat", can.BusState.PASSIVE, "active"),
        ("etas", can.BusState.PASSIVE, "passive"),
        ("slcan", can.BusState.ACTIVE, None),
    ],
)
def test_an_adapter_that_can_be_asked_is_asked(interface, answer, state):
    watch = ControllerWatch(interface)
    assert watch.ask(Asked(answer)) is (state is not None)
    assert watch.state == state
    assert watch.ask(Asked(answer)) is False
