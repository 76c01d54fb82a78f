"""Energy a lap that reaches the end: what is left over the laps to go, counted down by marks or by the lap's period."""

import pytest

from app.estimation.prediction.energy import EnergyLeft
from app.estimation.prediction.energy_target import EnergyTargetStore, RacePlan
from app.estimation.prediction.laps import LapWatch

LAP_S, FULL_WH = 60, 6_000.0
FAST_W, SLOW_W = 34_000.0, 2_000.0  # in the first and the second half of a lap
LAP_WH = 0.5 * (FAST_W + SLOW_W) * LAP_S / 3600


class Race:
    """A battery that gives FULL_WH down to an SOC of 0, and in which a slow lap loses no less than a fast one."""

    def __init__(self):
        self.watch, self.keeper, self.driven_s = LapWatch(), EnergyTargetStore(), 0

    def left(self, reserve_soc, pace):
        return EnergyLeft(FULL_WH * (1 - reserve_soc) - self.watch.now[1], 60.0, 1.0, 0)

    def plan(self, laps, reserve_soc=0.0):
        self.keeper.set(RacePlan(laps, reserve_soc), self.watch)

    def drive(self, seconds, *, mark=False):
        for _ in range(seconds):
            self.watch.step(1.0, FAST_W if self.driven_s % LAP_S < LAP_S / 2 else SLOW_W)
            self.driven_s += 1
        if mark:
            self.watch.mark()
        self.watch.judge()
        return self.keeper.judge(self.watch, self.left)


@pytest.fixture
def race():
    return Race()


def test_without_a_plan_there_is_no_target(race):
    assert race.drive(200) is None
    race.plan(5)
    assert race.drive(1) is not None
    race.keeper.set(None, race.watch)
    assert race.drive(1) is None


def test_what_is_left_is_shared_by_the_laps_to_go_and_the_reserve_is_not(race):
    race.plan(20, reserve_soc=0.1)
    target = race.drive(1)
    assert target.lap_energy_wh == pytest.approx(0.9 * FULL_WH / 20)
    assert target.low_wh < target.lap_energy_wh < target.high_wh
    assert (target.laps_to_go, target.expected_wh, target.last_lap_wh) == (20, None, None)


def test_a_mark_on_the_line_ends_a_lap_and_sets_the_next_target(race):
    race.plan(20, reserve_soc=0.3)
    first = race.drive(LAP_S - 1).lap_energy_wh
    after = race.drive(1, mark=True)
    assert (after.laps_to_go, after.counted_by) == (19, "marks")
    assert after.last_lap_wh == pytest.approx(LAP_WH, rel=0.02)
    assert after.lap_energy_wh == pytest.approx((0.7 * FULL_WH - LAP_WH) / 19, rel=0.01)
    assert after.lap_energy_wh < first, "that lap took more than its share"
    assert race.drive(LAP_S // 2).lap_energy_wh == after.lap_energy_wh, "it stays until the line"


def test_a_plan_made_within_a_lap_counts_what_was_used_of_it(race):
    race.drive(LAP_S, mark=True)
    race.drive(LAP_S // 2)
    race.plan(10)
    target = race.drive(1)
    assert target.used_wh == pytest.approx(0.5 * FAST_W * LAP_S / 3600, rel=0.02)
    assert target.lap_energy_wh == pytest.approx((FULL_WH - LAP_WH) / 10, rel=0.01)


def test_the_lap_is_compared_with_the_same_place_of_the_laps_before(race):
    race.plan(20)
    for _ in range(4):
        race.drive(LAP_S, mark=True)
    half = race.drive(LAP_S // 2)
    assert half.expected_wh / half.lap_energy_wh == pytest.approx(FAST_W / (FAST_W + SLOW_W), rel=0.05)
    assert half.used_wh / LAP_WH == pytest.approx(FAST_W / (FAST_W + SLOW_W), rel=0.05)


def test_a_mark_pressed_twice_or_at_the_start_is_no_lap(race):
    race.plan(20)
    race.drive(3, mark=True)
    assert race.drive(1).laps_to_go == 20
    race.drive(LAP_S, mark=True)
    assert race.drive(2, mark=True).laps_to_go == 19


def test_without_marks_the_laps_are_counted_by_the_period_of_the_power(race):
    seen = LapWatch()
    race.watch = seen
    while seen.laps is None:
        race.drive(5)
        assert seen.now[0] < 10 * LAP_S
    race.plan(10)
    target = race.drive(3 * LAP_S + 5)
    assert (target.laps_to_go, target.counted_by) == (7, "period")
    assert target.last_lap_wh == pytest.approx(LAP_WH, rel=0.1)


def test_after_the_last_lap_nothing_is_asked_of_a_lap(race):
    race.plan(1)
    race.drive(LAP_S, mark=True)
    over = race.drive(1)
    assert (over.laps_to_go, over.lap_energy_wh, over.low_wh) == (0, None, None)


def test_a_slower_pace_saves_losses_which_count(race):
    def left(reserve_soc, pace):
        return EnergyLeft(FULL_WH - 400.0 * pace - race.watch.now[1], 0.0, 1.0, 0)

    for _ in range(3):
        race.drive(LAP_S, mark=True)
    race.plan(40)
    race.watch.judge()
    target = race.keeper.judge(race.watch, left).lap_energy_wh
    spent = race.watch.now[1]
    assert 40 * target == pytest.approx(FULL_WH - spent - 400.0 * target / LAP_WH, rel=0.01)
