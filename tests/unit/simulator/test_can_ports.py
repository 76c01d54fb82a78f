import selectors
from collections.abc import Iterator

import can
import pytest

from app.sources.links.can import reported_state
from simulator.can_bus import BUS_OFF, PASSIVE, CanBus, CanFrame
from simulator.can_ports import PythonCanPort, can_port
from simulator.errors import PortError

FRAME = CanFrame(0x123, False, b"\1\2")


class Node:
    bit_rate = 500_000
    is_listening_only = False

    def __init__(self) -> None:
        self.received: list[CanFrame] = []

    def can_received(self, frame: CanFrame, now_s: float) -> None:
        self.received.append(frame)


@pytest.fixture
def bus() -> CanBus:
    return CanBus()


@pytest.fixture
def node(bus) -> Node:
    node = Node()
    bus.attach(node)
    return node


@pytest.fixture
def port(bus, request) -> Iterator[PythonCanPort]:
    port = can_port(f"virtual:{request.node.name}")
    with selectors.DefaultSelector() as selector:
        port.open(selector, bus, lambda: 0.0)
        yield port
        port.close()


@pytest.fixture
def computer(port, request) -> Iterator[can.BusABC]:
    with can.Bus(interface="virtual", channel=request.node.name) as computer:
        yield computer


def test_frames_go_both_ways(bus, node, port, computer):
    bus.send(node, FRAME, 0.0)
    bus.run(0.1)
    message = computer.recv(0)
    assert (message.arbitration_id, bytes(message.data), message.is_extended_id) == (0x123, b"\1\2", False)
    computer.send(can.Message(arbitration_id=0x18FF50E5, data=b"\7", is_extended_id=True))
    port.poll()
    bus.run(0.2)
    assert node.received == [CanFrame(0x18FF50E5, True, b"\7")]


@pytest.mark.parametrize(("errors", "state"), [(0, None), (100, "warning"), (PASSIVE, "passive")])
def test_the_virtual_bus_shows_error_frames_with_the_state_of_the_node(bus, node, port, computer, errors, state):
    bus.is_broken = True
    bus.station(port).receive_errors = errors
    bus.send(node, FRAME, 0.0)
    bus.run(0.1)
    message = computer.recv(0)
    assert message.is_error_frame
    assert reported_state(message) == state


def test_a_port_that_errors_took_off_the_bus_says_so(bus, node, port, computer):
    bus.is_broken = True
    bus.station(port).transmit_errors = BUS_OFF - 1
    computer.send(can.Message(arbitration_id=1, is_extended_id=False))
    port.poll()
    bus.run(0.001)
    bus.send(node, FRAME, 0.002)
    bus.run(0.1)
    states = []
    while (message := computer.recv(0)) is not None:
        states.append(reported_state(message))
    assert states[-1] == "off"


def test_a_closed_port_hears_and_tells_nothing(bus, node, port, computer):
    port.close()
    bus.is_broken = True
    bus.send(node, FRAME, 0.0)
    bus.run(0.1)
    assert computer.recv(0) is None


def test_a_log_is_what_candump_writes_and_is_read_again(bus, node, tmp_path):
    log = can_port(f"log:{tmp_path / 'a.log'}")
    with selectors.DefaultSelector() as selector:
        log.open(selector, bus, lambda: 0.0)
        frames = [FRAME, CanFrame(0x18FF50E5, True, b""), CanFrame(0x321, False, bytes(range(64)))]
        for n, frame in enumerate(frames):
            bus.send(node, frame, float(n))
            bus.run(n + 0.5)
        log.close()
    with can.CanutilsLogReader(tmp_path / "a.log") as reader:
        found = [(m.arbitration_id, m.is_extended_id, bytes(m.data), m.is_fd) for m in reader]
    assert found == [(f.can_id, f.is_extended, f.data, f.is_fd) for f in frames]


def test_a_log_that_cannot_be_written_is_refused(bus, tmp_path):
    with selectors.DefaultSelector() as selector, pytest.raises(PortError, match="log:"):
        can_port(f"log:{tmp_path}").open(selector, bus, lambda: 0.0)


def test_frames_of_can_fd_reach_a_bus_as_such(bus, node, request):
    fd = can_port(f"virtual:{request.node.name}")
    fd.carry_fd()
    with selectors.DefaultSelector() as selector, can.Bus(interface="virtual", channel=request.node.name) as listener:
        fd.open(selector, bus, lambda: 0.0)
        bus.send(node, CanFrame(0x321, False, bytes(48)), 0.0)
        bus.run(1.0)
        message = listener.recv(1.0)
        fd.close()
    assert (message.is_fd, message.bitrate_switch, len(message.data)) == (True, True, 48)
