"""The two links against each other: noise and motion are no disagreement, another value is."""

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


def test_equal_and_nearly_equal_values_agree():
    links = Links()
    assert all(links.step(35000 + i % 3, 35001) == () for i in range(60))


def test_a_value_that_moves_may_be_seen_a_moment_apart():
    links = Links()
    assert all(links.step(30000 + 50 * i, 30000 + 50 * i + 40) == () for i in range(60))


def test_another_value_is_told_once_it_has_lasted():
    links = Links()
    told = [links.step(35000, 34000) for _ in range(40)]
    assert told[10] == (), "a second is no verdict"
    [found] = told[-1]
    assert (found.name, found.rs232, found.can, found.unit) == ("v_tot", 350.0, 340.0, "V")
    assert all(links.step(35000, 35000) == () for _ in range(3)), "and ends when they agree"


def test_what_can_does_not_repeat_is_forgotten():
    links = Links()
    for _ in range(40):
        links.step(35000, 34000)
    assert [bool(links.step(35000, None, 1.0)) for _ in range(8)][-1] is False


def test_a_value_of_which_can_carries_half_is_not_compared():
    links = Links()
    links.agreement.watch([])
    assert all(links.step(35000, 34000) == () for _ in range(40))
