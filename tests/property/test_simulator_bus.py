"""The bus and the link: whatever is sent or switched, nothing is lost, doubled or out of nothing."""

import itertools

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from simulator.bms_state import RelayState
from simulator.can_bus import CanBus, CanFrame
from simulator.vehicle import LinkCircuit
from tests.campaign import examples

RATE = 500_000
frames = st.builds(
    lambda can_id, is_extended, data: CanFrame(can_id if is_extended else can_id & 0x7FF, is_extended, data),
    st.integers(0, 0x1FFFFFFF),
    st.booleans(),
    st.binary(max_size=8),
)


class Node:
    bit_rate = RATE
    is_listening_only = False

    def __init__(self) -> None:
        self.received: list[tuple[float, CanFrame]] = []

    def can_received(self, frame: CanFrame, now_s: float) -> None:
        self.received.append((now_s, frame))


@settings(deadline=None, max_examples=examples(60))
@given(st.lists(st.tuples(st.integers(0, 2), st.integers(0, 40), frames), max_size=40), st.sampled_from([0.0, 1e-3]))
def test_every_frame_reaches_every_other_node_once_and_the_bus_carries_one_at_a_time(sent, noise):
    bus, nodes = CanBus(np.random.default_rng(3)), [Node() for _ in range(3)]
    bus.noise_per_bit = noise
    for node in nodes:
        bus.attach(node)
    by_node = {index: [] for index in range(3)}
    now_s = 0.0
    for index, wait_ms, frame in sent:
        now_s += wait_ms * 1e-3
        bus.run(now_s)
        bus.send(nodes[index], frame, now_s)
        by_node[index].append(frame)
    bus.run(now_s + 1.0)
    for index, node in enumerate(nodes):
        expected = [frame for other, theirs in by_node.items() if other != index for frame in theirs]
        assert sorted(map(repr, (frame for _, frame in node.received))) == sorted(map(repr, expected))
    ends = sorted({(at_s, frame.bits / RATE) for node in nodes for at_s, frame in node.received})
    for (before_s, _), (after_s, length_s) in itertools.pairwise(ends):
        assert after_s - before_s >= length_s - 1e-9


@settings(max_examples=examples(60))
@given(
    st.lists(
        st.tuples(st.floats(1e-3, 5.0), st.floats(200.0, 404.0), st.sampled_from(list(RelayState))),
        min_size=1,
        max_size=30,
    ),
    st.one_of(st.just(float("inf")), st.floats(10.0, 1e6)),
)
def test_the_link_stays_between_nothing_and_the_accumulator_and_takes_what_it_holds(course, leak_ohm):
    link = LinkCircuit()
    link.leak_ohm = leak_ohm
    highest_v = 0.0
    for dt_s, source_v, relays in course:
        before_v = link.voltage_v
        current_a = link.step(dt_s, source_v, relays)
        highest_v = max(highest_v, source_v)
        assert 0.0 <= link.voltage_v <= highest_v + 1e-9
        if relays is RelayState.PRECHARGE:
            stored_a_s = link.parameters.capacitance_f * (link.voltage_v - before_v)
            assert current_a * dt_s >= stored_a_s - 1e-9  # the rest leaks
            if leak_ohm == float("inf"):
                assert abs(current_a * dt_s - stored_a_s) < 1e-9
        elif relays is not RelayState.VEHICLE:
            assert current_a == 0.0
