import numpy as np
import pytest

from app.estimation.errors import ShapeError
from app.estimation.health.joint_watch import CONFIRMATIONS, JointWatch

N, PER_PACK = 96, 12
PAIR_OHM = 1e-3  # of the RC pair, 10 s


def drive(watch, resistance_ohm, seconds, rng):
    """Bursts of current over cells of a flat OCV and one RC pair; judges every 2.5 s; returns the indices named."""
    named, pair_a, current_a = set(), 0.0, 0.0
    for k in range(round(seconds * 10)):
        if k % 12 == 0:
            current_a = rng.choice([-60.0, 0.0, 20.0, 120.0, 200.0])
        pair_a += 0.01 * (current_a - pair_a)
        voltages_v = 3.7 - resistance_ohm * current_a - PAIR_OHM * pair_a + rng.normal(0, 1e-3, N)
        watch.step(0.1, current_a, voltages_v)
        if k % 25 == 24:
            watch.judge()
            named |= set(np.flatnonzero(watch.loose).tolist())
    return named


@pytest.fixture
def cells():
    rng = np.random.default_rng(5)
    return rng, 2e-3 + rng.normal(0, 2e-5, N)


def test_a_joint_that_grows_is_named_within_a_lap_and_no_other(cells):
    rng, resistance_ohm = cells
    watch = JointWatch(N, PER_PACK)
    assert drive(watch, resistance_ohm, 150, rng) == set()
    loose = resistance_ohm.copy()
    loose[7] += 3e-4
    assert drive(watch, loose, 60, rng) == {7}


def test_a_joint_that_was_loose_from_the_start_is_named_without_a_past(cells):
    rng, resistance_ohm = cells
    resistance_ohm[20] += 4e-4
    assert 20 in drive(JointWatch(N, PER_PACK), resistance_ohm, 120, rng)


def test_a_loose_joint_does_not_become_the_new_normal(cells):
    rng, resistance_ohm = cells
    watch = JointWatch(N, PER_PACK)
    drive(watch, resistance_ohm, 150, rng)
    before = watch.baseline_ohm[7]
    resistance_ohm[7] += 3e-4
    drive(watch, resistance_ohm, 300, rng)
    assert watch.loose[7]
    assert abs(watch.baseline_ohm[7] - before) < 1e-4


def test_the_past_of_an_earlier_session_is_used(cells):
    rng, resistance_ohm = cells
    first = JointWatch(N, PER_PACK)
    drive(first, resistance_ohm, 150, rng)
    second = JointWatch(N, PER_PACK, first.baseline_ohm)
    resistance_ohm[3] += 2.5e-4
    assert 3 in drive(second, resistance_ohm, 90, rng)


def test_one_judgement_names_nobody():
    assert CONFIRMATIONS > 1
    assert not JointWatch(N, PER_PACK).loose.any()


def test_a_past_of_other_cells_is_refused():
    with pytest.raises(ShapeError):
        JointWatch(N, PER_PACK, np.zeros(5))
