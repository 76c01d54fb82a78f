"""Links that are not configured refuse; which are stuck."""

import pytest

from app.clock import Clock
from app.errors import LinkLost
from app.service.links import STUCK_S, Links
from app.words import Message
from tests.fake_clock import FakeClock


def links(serial_url=None, can_url=None, *, may_transmit=False):
    return Links(serial_url, can_url, lambda item: None, Clock(), may_transmit=may_transmit)


def test_without_a_serial_port_requests_and_the_stream_are_refused():
    with pytest.raises(LinkLost, match="no RS232 port"):
        links().master.identify()
    with pytest.raises(LinkLost, match="no RS232 port"):
        links().stream(on=True)


def test_without_a_can_bus_nothing_is_sent():
    with pytest.raises(LinkLost, match="no CAN bus"):
        links().can_sender._send(1, b"")


@pytest.mark.parametrize(
    ("can_url", "may_transmit", "reason"),
    [
        (None, True, Message("no-can")),
        ("virtual:test", False, Message("bench-only")),
        ("virtual:test", True, None),
    ],
)
def test_frames_are_only_sent_where_no_car_is(can_url, may_transmit, reason):
    found = links(None, can_url, may_transmit=may_transmit).transmit_block_reason
    assert found == reason


def test_closed_links_are_not_opened():
    made = links("loop://")
    made.close()
    made.open()
    assert not made.serial._thread.is_alive()


def test_links_are_stuck_whose_thread_their_driver_keeps():
    clock = FakeClock()
    made = Links("loop://", "virtual:test", lambda item: None, clock, may_transmit=True)
    assert made.stuck() == [], "not opened yet"
    made.serial.beat_ns = made.can.beat_ns = clock.monotonic_ns()
    clock.advance(STUCK_S - 1)
    made.can.beat_ns = clock.monotonic_ns()
    assert made.stuck() == []
    clock.advance(2)
    assert [found.code for found in made.stuck()] == ["rs232-stuck"]
    clock.advance(STUCK_S)
    assert [found.code for found in made.stuck()] == ["rs232-stuck", "can-stuck"]
