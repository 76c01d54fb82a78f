import time
from dataclasses import dataclass

import pytest

from app.api.web.connection_limits import CROWD, FEWEST, KEPT_ASIDE, MOST, ClientConnections, most_connections


@dataclass(eq=False)
class Open:
    address: str
    connections: ClientConnections
    is_websocket: bool = False
    is_cut: bool = False

    def cut(self):
        self.is_cut = True
        self.connections.discard(self)

    def shutdown(self):
        self.cut()


def opened(connections, address, is_waiting=False, is_websocket=False):
    made = Open(address, connections)
    if not connections.add(made):
        return None
    if not is_waiting:
        connections.stop_waiting(made)
    if is_websocket:
        assert connections.upgrade(made)
    return made


def test_descriptors_are_kept_aside():
    assert most_connections(1024) == 1024 - KEPT_ASIDE
    assert most_connections(10) == FEWEST
    assert most_connections(None) == most_connections(1 << 20) == MOST


def test_who_waits_longest_for_a_request_makes_room():
    connections = ClientConnections(10)
    held = [opened(connections, f"10.0.0.{i}", is_waiting=True) for i in range(8)]
    held.append(opened(connections, "10.0.1.1"))  # at work
    connections.stop_waiting(held[0])
    connections.start_waiting(held[1])  # for the next request, after all others
    assert opened(connections, "10.0.2.2")
    assert [each.is_cut for each in held] == [False, False, True, *[False] * 6]


def test_nobody_at_work_makes_room(caplog):
    connections = ClientConnections(10)
    for i in range(9):
        opened(connections, f"10.0.0.{i}")
    assert opened(connections, "10.0.2.2") is None
    assert caplog.messages == ["refused a connection of 10.0.2.2: too many are open"]


def test_a_flood_from_one_address_leaves_half_to_the_others():
    connections = ClientConnections(10)
    held = [opened(connections, "10.0.0.1") for _ in range(5)] + [opened(connections, "10.0.0.2", is_waiting=True)]
    assert opened(connections, "10.0.0.1") is None
    assert opened(connections, "10.0.0.3")
    assert not any(each.is_cut for each in held)


@pytest.mark.parametrize(("own", "others", "may"), [(14, 0, True), (15, 0, False), (0, 29, True), (0, 30, False)])
def test_a_quarter_is_kept_for_plain_requests(own, others, may):
    connections = ClientConnections(40)
    for _ in range(own):
        opened(connections, "10.0.0.1", is_websocket=True)
    for i in range(others):
        opened(connections, f"10.0.1.{i}", is_websocket=True)
    assert connections.upgrade(opened(connections, "10.0.0.1")) is may


def test_one_that_left_counts_no_more():
    connections = ClientConnections(40)
    for each in [opened(connections, "10.0.0.1", is_waiting=True, is_websocket=True) for _ in range(15)]:
        connections.discard(each)
        connections.discard(each)
    assert len(connections) == 0
    assert opened(connections, "10.0.0.1", is_websocket=True)


def test_a_crowd_that_is_gone_is_reported_once():
    gone = []
    connections = ClientConnections(on_crowd_gone=lambda: gone.append(len(connections)))
    for _ in range(2):
        held = [opened(connections, "10.0.0.1") for _ in range(CROWD)]
        for each in held:
            connections.discard(each)
    assert gone == [CROWD // 4 - 1] * 2
    connections.discard(opened(connections, "10.0.0.1"))
    assert len(gone) == 2


def test_room_is_made_as_fast_among_thousands_as_among_a_few():
    def takes_s(most):
        connections = ClientConnections(most)
        for i in range(most):
            opened(connections, f"10.0.0.{i % 3}", is_waiting=True)
        began_s = time.process_time()
        for i in range(2000):
            assert opened(connections, f"10.0.0.{i % 3}", is_waiting=True)
        return time.process_time() - began_s

    assert takes_s(MOST) < 10 * takes_s(MOST // 64)
