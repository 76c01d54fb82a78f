"""Two frames for the driver: what stands in them, that the unknown is not a number, and whose ids are refused."""

import threading
from dataclasses import dataclass
from types import SimpleNamespace

import pytest

from app.clock import Clock
from app.errors import LinkLost, NotNow
from app.sources.links.driver_display import DriverDisplay, DriverFrame
from app.words import Message

TARGET = DriverFrame(0x6A0, 8, 2, "little", 100)
MESSAGE = DriverFrame(0x6A1 | 1 << 31, 1, 0, "little", 100)


@dataclass
class Car:
    """A bus that keeps what it is sent, and the snapshot of a car."""

    wh: float | None = 286.4
    age_s: float = 0.2

    def __post_init__(self):
        self.frames = {}
        self.wanted = None
        self.is_there = threading.Event()
        self.is_away = False

    def send(self, can_id, data):
        if self.is_away:
            self.is_there.set()
            raise LinkLost(Message("can-not-open"))
        self.frames[can_id] = data
        if (can_id, data) == self.wanted:
            self.is_there.set()

    def awaits(self, frame, data):
        self.wanted = frame.can_id, data
        self.is_there.clear()
        assert self.is_there.wait(5), self.frames

    def snapshot(self):
        target = None if self.wh is None else SimpleNamespace(lap_energy_wh=self.wh)
        return SimpleNamespace(
            t_mono_ns=Clock().monotonic_ns(), prediction=SimpleNamespace(target=target, age_s=self.age_s)
        )


@pytest.fixture
def car():
    return Car()


@pytest.fixture
def display(car):
    made = DriverDisplay(car.send, car.snapshot, lambda: {0x100}, Clock())
    yield made
    made.stop()


def test_nothing_is_sent_before_somebody_maps_it(display, car):
    display.show("box")
    assert car.frames == {}


def test_both_frames_hold_their_value_where_it_was_mapped(display, car):
    display.send(TARGET, MESSAGE, "ada")
    car.awaits(TARGET, bytes.fromhex("0000 1e01 0000 0000"))
    assert DriverFrame(1, 4, 1, "big", 100).data(0x1234, 2) == bytes.fromhex("00 1234 00")
    display.show("box")
    car.awaits(MESSAGE, b"\x03")
    display.send(None, None, "ada")
    assert display.target is None
    assert display.sent == 0


@pytest.mark.parametrize(("wh", "age_s"), [(None, 0.2), (286.4, 11.0)])
def test_a_target_that_is_unknown_or_old_is_sent_as_unknown(display, car, wh, age_s):
    car.wh, car.age_s = wh, age_s
    display.send(TARGET, None, "ada")
    car.awaits(TARGET, bytes.fromhex("0000 ffff 0000 0000"))


def test_the_id_of_anybody_else_is_refused_and_what_was_sent_goes_on(display, car):
    display.send(TARGET, None, "ada")
    with pytest.raises(NotNow, match="0x100"):
        display.send(DriverFrame(0x100, 8, 0, "little", 100), None, "ada")
    with pytest.raises(NotNow, match="0x6a0"):
        display.send(TARGET, TARGET, "ada")
    assert display.target is TARGET
    car.awaits(TARGET, TARGET.data(286, 2))


def test_a_bus_that_is_away_is_told_and_does_not_end_it(display, car):
    car.is_away = True
    display.send(TARGET, None, "ada")
    assert car.is_there.wait(5)
    car.is_away = False
    car.awaits(TARGET, TARGET.data(286, 2))
    assert display.error is None
