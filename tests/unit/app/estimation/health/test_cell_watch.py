import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.health.cell_watch import JUDGE_S, CellWatch

N, PER_PACK, DT_S = 96, 12, 0.1
PAIR_OHM = 1e-3
WARM = np.full(N, 30.0)


class Car:
    """Cells of a flat OCV with one RC pair, and the clock of the watch that sees them."""

    def __init__(self, watch, seed=5):
        self.watch, self.rng = watch, np.random.default_rng(seed)
        self.resistance_ohm = 2e-3 + self.rng.normal(0, 2e-5, N)
        self.time_s = self.pair_a = 0.0

    def drive(self, seconds, currents_a=(-60.0, 0.0, 20.0, 120.0, 200.0)):
        current_a = 0.0
        for k in range(round(seconds / DT_S)):
            if k % 12 == 0:
                current_a = self.rng.choice(currents_a)
            self._sample(current_a)

    def stand(self, seconds):
        for _ in range(round(seconds / DT_S)):
            self._sample(0.0)

    def _sample(self, current_a):
        self.time_s += DT_S
        self.pair_a += DT_S / 10.0 * (current_a - self.pair_a)
        noise_v = self.rng.normal(0, 1e-3, N)
        voltages_v = 3.7 - self.resistance_ohm * current_a - PAIR_OHM * self.pair_a + noise_v
        self.watch.step(self.time_s, DT_S, current_a + self.rng.normal(0, 0.2), voltages_v, WARM)
        if round(self.time_s / DT_S) % round(JUDGE_S / DT_S) == 0:
            self.watch.judge()


@pytest.fixture
def cell():
    return load_cell()


def new_watch(cell, memory=None):
    return CellWatch(cell, N, PER_PACK, memory)


def joints(watch):
    return {each.cell: each for each in watch.findings if each.code == "joint-grown"}


def test_a_grown_joint_is_a_finding_with_its_size_and_evidence(cell):
    car = Car(new_watch(cell))
    car.drive(100)
    assert car.watch.findings == ()
    before_s = car.time_s
    car.resistance_ohm[63] += 14e-3
    car.drive(60)
    found = joints(car.watch)
    assert list(found) == [63]
    low, high = found[63].band
    assert low <= 14e-3 <= high
    assert found[63].since_s >= before_s
    assert found[63].current_a > 30.0
    assert found[63].confidence > 0.95


def test_a_finding_stands_still_while_the_car_does(cell):
    car = Car(new_watch(cell))
    car.drive(60)
    car.resistance_ohm[63] += 14e-3
    car.drive(60)
    before = joints(car.watch)[63]
    car.stand(900)
    after = joints(car.watch)[63]
    assert after.size == pytest.approx(before.size, rel=0.05)
    assert after.seen_s == pytest.approx(before.seen_s, abs=10.0)
    assert car.watch.resistance_age_s > 880


def test_a_finding_survives_a_restart_until_driving_shows_a_sound_joint(cell):
    car = Car(new_watch(cell))
    car.drive(60)
    car.resistance_ohm[63] += 14e-3
    car.drive(60)
    before = joints(car.watch)[63]
    car.watch = new_watch(cell, car.watch.memory)
    car.stand(60)
    assert joints(car.watch) == {63: before}
    car.resistance_ohm[63] -= 14e-3
    car.drive(90)
    assert car.watch.findings == ()


def test_a_missing_voltage_is_no_evidence_of_a_sound_joint(cell):
    car = Car(new_watch(cell))
    car.resistance_ohm[63] += 14e-3
    car.drive(100)
    assert list(joints(car.watch)) == [63]
    car.resistance_ohm[63] = np.nan
    car.drive(100)
    assert list(joints(car.watch)) == [63]
