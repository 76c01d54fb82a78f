"""Links that are not configured refuse; which are stuck; whom a request reaches."""

import os
import queue
import tty
from concurrent.futures import ThreadPoolExecutor

import pytest

from app.clock import Clock
from app.errors import LinkLost
from app.service.links import STUCK_S, ServiceLinks
from app.sources.items import LinkChange
from app.words import Message
from firmware_protocol.framing import START_STREAM, STOP_STREAM, FrameDecoder
from tests.fake_clock import FakeClock


def links(serial_url=None, can_url=None, *, may_transmit=False):
    return ServiceLinks(serial_url, can_url, lambda item: None, Clock(), may_transmit=may_transmit)


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
    made = ServiceLinks("loop://", "virtual:test", lambda item: None, clock, may_transmit=True)
    assert made.stuck() == [], "not opened yet"
    made.serial.beat_ns = made.can.beat_ns = clock.monotonic_ns()
    clock.advance(STUCK_S - 1)
    made.can.beat_ns = clock.monotonic_ns()
    assert made.stuck() == []
    clock.advance(2)
    assert [found.code for found in made.stuck()] == ["rs232-stuck"]
    clock.advance(STUCK_S)
    assert [found.code for found in made.stuck()] == ["rs232-stuck", "can-stuck"]


@pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals")
def test_another_master_on_the_same_port_gets_nothing_of_what_the_first_was_asked(tmp_path):
    """As by an adapter that is plugged into the next car while a reply is awaited."""
    port, items = tmp_path / "port", queue.SimpleQueue()

    def plug_in() -> int:
        ours, theirs = os.openpty()
        tty.setraw(theirs)
        port.symlink_to(os.ttyname(theirs))
        os.close(theirs)
        return ours

    def wait_until_open() -> None:
        while not isinstance(item := items.get(timeout=10), LinkChange) or item.state != "open":
            pass

    first = plug_in()
    made = ServiceLinks(str(port), None, items.put, Clock(), may_transmit=False)
    with ThreadPoolExecutor() as pool:
        made.open()
        wait_until_open()
        asked, decoder = pool.submit(made.master.identify), FrameDecoder()
        while not decoder.feed(os.read(first, 4096)):
            pass
        port.unlink()
        second = plug_in()
        os.close(first)
        wait_until_open()
        with pytest.raises(LinkLost, match="lost before the reply"):
            asked.result(timeout=10)
    made.close()
    received = b""
    while not received.endswith(bytes([STOP_STREAM])):
        received += os.read(second, 4096)
    os.close(second)
    assert received == bytes([START_STREAM, STOP_STREAM])
