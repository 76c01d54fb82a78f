from dataclasses import dataclass

import pytest

from app.api.web.connection_limits import FEWEST, KEPT_ASIDE, MOST, make_room, may_upgrade, most_connections


@dataclass
class Open:
    client: tuple[str, int] | None
    waits_since_s: float | None = None
    is_websocket: bool = False
    is_cut: bool = False

    def cut(self):
        self.is_cut = True


def test_descriptors_are_kept_aside():
    assert most_connections(1024) == 1024 - KEPT_ASIDE
    assert most_connections(10) == FEWEST
    assert most_connections(None) == most_connections(1 << 20) == MOST


def test_who_waits_longest_for_a_request_makes_room():
    held = [Open((f"10.0.0.{i}", 1), waits_since_s=9.0 - i) for i in range(8)]
    held.append(Open(("10.0.1.1", 1)))  # at work
    assert make_room(held, "10.0.2.2", 10)
    assert [each.is_cut for each in held] == [False] * 7 + [True, False]


def test_nobody_at_work_makes_room():
    held = [Open((f"10.0.0.{i}", 1)) for i in range(9)]
    assert not make_room(held, "10.0.2.2", 10)


def test_a_flood_from_one_address_leaves_half_to_the_others():
    held = [Open(("10.0.0.1", i)) for i in range(5)] + [Open(("10.0.0.2", 1), waits_since_s=1.0)]
    assert not make_room(held, "10.0.0.1", 10)
    assert make_room(held, "10.0.0.3", 10)
    assert not any(each.is_cut for each in held)


@pytest.mark.parametrize(("own", "others", "may"), [(14, 0, True), (15, 0, False), (0, 29, True), (0, 30, False)])
def test_a_quarter_is_kept_for_plain_requests(own, others, may):
    held = [Open(("10.0.0.1", i), is_websocket=True) for i in range(own)]
    held += [Open((f"10.0.1.{i}", 1), is_websocket=True) for i in range(others)]
    assert may_upgrade(held, "10.0.0.1", 40) is may
