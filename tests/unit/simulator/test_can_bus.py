import numpy as np
import pytest

from simulator.can_bus import (
    BUS_OFF,
    MAX_AGE_S,
    PASSIVE,
    RECOVERY_BITS,
    SENDER_STEP,
    CanBus,
    CanFrame,
)

RATE = 500_000
STANDARD = CanFrame(0x100, False, bytes(8))
EXTENDED = CanFrame(0x18FF50E5, True, bytes(8))


class Node:
    def __init__(self, bus: CanBus, bit_rate: int = RATE, *, listens_only: bool = False) -> None:
        self.bit_rate = bit_rate
        self.is_listening_only = listens_only
        self.received: list[tuple[float, CanFrame]] = []
        bus.attach(self)

    def can_received(self, frame: CanFrame, now_s: float) -> None:
        self.received.append((now_s, frame))

    @property
    def frames(self) -> list[CanFrame]:
        return [frame for _, frame in self.received]


@pytest.fixture
def bus() -> CanBus:
    return CanBus(np.random.default_rng(1))


@pytest.fixture
def sender(bus) -> Node:
    return Node(bus)


@pytest.fixture
def listener(bus) -> Node:
    return Node(bus)


@pytest.mark.parametrize(("frame", "least", "most"), [(STANDARD, 111, 135), (EXTENDED, 131, 160)])
def test_a_frame_arrives_when_its_last_bit_has_passed(bus, sender, listener, frame, least, most):
    bus.send(sender, frame, 1.0)
    bus.run(1.0)
    assert listener.received == []
    bus.run(1.01)
    assert least <= (listener.received[0][0] - 1.0) * RATE <= most
    assert sender.received == []
    assert bus.due_s == float("inf")


def test_the_lower_identifier_goes_first_and_standard_before_extended(bus, sender, listener):
    frames = [
        CanFrame(0x200, False, b""),
        CanFrame(0x100 << 18, True, b""),
        CanFrame(0x100, False, b""),
        CanFrame(0x7FF, False, b""),
        CanFrame(0x0FF << 18 | 0x3FFFF, True, b""),
    ]
    other = Node(bus)
    for index, frame in enumerate(frames):
        bus.send((sender, other)[index % 2], frame, 1.0)
    bus.run(1.01)
    assert listener.frames == [frames[k] for k in (4, 2, 1, 0, 3)]


def test_a_frame_under_way_is_not_interrupted(bus, sender, listener):
    bus.send(sender, CanFrame(0x700, False, b""), 1.0)
    bus.run(1.0)
    bus.send(listener, CanFrame(0x001, False, b""), 1.00001)
    other = Node(bus)
    bus.run(1.1)
    assert [frame.can_id for frame in other.frames] == [0x700, 0x001]


def test_a_busy_bus_carries_no_more_than_its_rate(bus, sender, listener):
    for k in range(60):
        bus.send(sender, CanFrame(k, False, bytes(8)), 1.0)
    bus.run(1.2)
    times = np.array([at_s for at_s, _ in listener.received])
    assert len(times) == 60
    assert np.diff(times).min() * RATE >= 111


def test_what_waits_too_long_is_given_up(bus, sender):
    bus.send(sender, STANDARD, 1.0)
    bus.run(1.0 + 2 * MAX_AGE_S)
    late = Node(bus)
    bus.run(2.0)
    assert late.frames == []
    bus.send(sender, EXTENDED, 2.0)
    bus.run(2.1)
    assert late.frames == [EXTENDED]


def test_a_sender_alone_becomes_passive_and_never_leaves_the_bus(bus, sender):
    for k in range(100):
        bus.send(sender, STANDARD, 0.1 * k)
        bus.run(0.1 * k + 0.09)
    assert bus.station(sender).transmit_errors == PASSIVE
    assert not bus.is_off(sender)


def test_who_only_listens_acknowledges_nothing_and_hears_what_is_acknowledged(bus, sender):
    spy = Node(bus, listens_only=True)
    bus.send(sender, STANDARD, 1.0)
    bus.run(1.1)
    assert spy.frames == []
    Node(bus)
    bus.run(1.19)
    assert spy.frames == [STANDARD]


def test_a_short_circuit_takes_the_sender_off_until_the_bus_is_idle_again(bus, sender, listener):
    bus.is_broken = True
    bus.send(sender, STANDARD, 1.0)
    bus.run(1.1)
    assert bus.is_off(sender)
    assert bus.error_frames == BUS_OFF // SENDER_STEP
    bus.send(sender, STANDARD, 1.2)
    bus.run(5.0)
    bus.is_broken = False
    bus.run(5.0 + 0.9 * RECOVERY_BITS / RATE)
    assert bus.is_off(sender)
    bus.run(5.0 + 1.1 * RECOVERY_BITS / RATE)
    assert not bus.is_off(sender)
    bus.send(sender, EXTENDED, 6.0)
    bus.run(6.1)
    assert listener.frames == [EXTENDED]


def test_noise_delays_frames_and_loses_none(bus, sender, listener):
    bus.noise_per_bit = 1e-3
    for k in range(500):
        bus.send(sender, CanFrame(k, False, bytes(8)), 0.01 * k)
        bus.run(0.01 * k + 0.009)
    assert [frame.can_id for frame in listener.frames] == list(range(500))
    share = bus.error_frames / (bus.error_frames + bus.frames)
    assert share == pytest.approx(1 - (1 - 1e-3) ** STANDARD.bits, rel=0.3)
    assert not bus.is_off(sender)


def test_a_node_at_another_rate_destroys_frames_until_one_of_the_two_gives_up(bus, sender, listener):
    stranger = Node(bus, 250_000)
    for k in range(30):
        bus.send(sender, STANDARD, 0.01 * k)
        bus.run(0.01 * k + 0.009)
        if bus.is_off(sender):
            break
    assert bus.is_off(sender)
    assert stranger.frames == []
    assert bus.station(stranger).receive_errors > 0


def test_a_stranger_that_only_listens_does_no_harm(bus, sender, listener):
    stranger = Node(bus, 250_000, listens_only=True)
    bus.send(sender, STANDARD, 0.0)
    bus.run(0.1)
    assert listener.frames == [STANDARD]
    assert stranger.frames == []


def test_a_node_off_its_bus_sends_nothing(bus, sender, listener):
    sender.bit_rate = 0
    bus.send(sender, STANDARD, 0.0)
    bus.run(1.0)
    assert listener.frames == []


def test_a_node_that_leaves_takes_its_frame_along(bus, sender, listener):
    bus.send(sender, STANDARD, 0.0)
    bus.run(0.0)
    bus.detach(sender)
    bus.run(1.0)
    assert listener.frames == []


def test_error_frames_are_told(bus, sender, listener):
    told = []
    bus.error_listeners.append(lambda: told.append(1))
    bus.is_broken = True
    bus.send(sender, STANDARD, 0.0)
    bus.run(0.1)
    assert len(told) == bus.error_frames > 0
