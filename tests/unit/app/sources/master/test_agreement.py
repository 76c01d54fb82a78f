"""The two links against each other: noise and motion are no disagreement, another value is."""

import pytest

from app.sources.master.agreement import Agreement
from app.sources.master.shadow import ShadowImage
from firmware_protocol.can_tables import tx_messages
from firmware_protocol.config_image import default_image
from firmware_protocol.memory_map import FIELDS
from firmware_protocol.messages import Window

V_TOT = FIELDS["v_tot"]


class Links:
    def __init__(self):
        self.agreement = Agreement()
        self.agreement.watch(tx_messages(default_image()))
        self.shadow = ShadowImage()
        self.t_ns = 0

    def step(self, rs232: int, can: int | None, seconds: float = 0.1):
        self.t_ns += int(seconds * 1e9)
        self.shadow.write((Window(V_TOT.offset, rs232.to_bytes(2, "little")),), self.t_ns)
        self.agreement.on_rs232(self.shadow, self.t_ns)
        if can is not None:
            self.agreement.on_can((Window(V_TOT.offset, can.to_bytes(2, "little")),), self.t_ns + 1000)
        return self.agreement.disagreements(self.t_ns + 1000)


def differing():
    links = Links()
    for _ in range(40):
        links.step(35000, 34000)
    return links


def test_a_value_that_moves_may_be_seen_a_second_apart():
    links = Links()
    assert all(links.step(30000 + 50 * i, 30000 + 50 * i - 600) == () for i in range(60))


def test_another_value_is_told_once_it_has_lasted_and_until_they_agree():
    links = Links()
    links.step(35000, 35000)
    told = [links.step(35000, 34000) for _ in range(40)]
    assert told[10] == (), "a second is no verdict"
    [found] = told[-1]
    assert (found.name, found.rs232, found.can, found.unit) == ("v_tot", 350.0, 340.0, "V")
    assert found.since_ns == 200_001_000
    assert all(links.step(35000, 35000) == () for _ in range(3))


def test_what_can_does_not_repeat_is_forgotten():
    links = differing()
    assert [bool(links.step(35000, None, 1.0)) for _ in range(8)][-1] is False


def test_a_value_of_which_can_carries_half_is_not_compared():
    links = Links()
    links.agreement.watch([])
    assert all(links.step(35000, 34000) == () for _ in range(40))


@pytest.mark.parametrize(
    ("rs232", "can", "is_told"),
    [
        (35000, 34997, False),
        (35000, 35003, False),
        (35000, 35000 + 174, False),
        (35000, 35000 + 180, True),
        (10, 13, False),
        (10, 14, True),  # near zero the counts are what is left
    ],
)
def test_a_difference_of_three_counts_or_half_a_percent_is_none(rs232, can, is_told):
    links = Links()
    assert bool([links.step(rs232, can) for _ in range(40)][-1]) is is_told


def test_a_difference_has_to_last_two_seconds_without_a_break():
    links = Links()
    for _ in range(5):
        assert not any(links.step(35000, 34000) for _ in range(15))
        links.step(35000, 35000)


@pytest.mark.parametrize("is_brought", [True, False])
def test_what_rs232_does_not_bring_or_not_any_more_is_not_compared(is_brought):
    links = Links()
    if is_brought:
        links.step(35000, 35000)
    for i in range(40):
        links.agreement.on_can((Window(V_TOT.offset, b"\x00\x00"),), links.t_ns + 3_000_000_000 + i * 100_000_000)
    assert links.agreement.disagreements(links.t_ns + 7_000_000_000) == ()


def test_a_disagreement_survives_a_new_list_of_the_same_messages():
    links = differing()
    links.agreement.watch(tx_messages(default_image()))
    assert [found.name for found in links.step(35000, 34000)] == ["v_tot"]
