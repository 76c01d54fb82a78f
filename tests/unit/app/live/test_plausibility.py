"""Numbers that ought to agree."""

from types import SimpleNamespace

import numpy as np
import pytest

from app.live.plausibility import PlausibilityChecks
from app.sources.loaded_battery import team_battery

DT_S = 0.1
RESISTANCE_OHM = 0.0021


NO_CHIPS = np.full(96, np.nan)


def drive(check, steps, *, resistance_ohm=RESISTANCE_OHM, chips_v=NO_CHIPS, seed=1):
    """Feed currents that change every second; return the cells' voltages at the end."""
    rng = np.random.default_rng(seed)
    cells_v = np.full(96, 3.7)
    for i in range(steps):
        current_a = 80.0 if i // 10 % 2 else 0.0
        cells_v = 3.7 - resistance_ohm * current_a + rng.normal(0, 1e-3, 96)
        check.step(DT_S if i else None, current_a, cells_v, chips_v)
    return cells_v


def verdicts(check, cells_v, total_v=None, ages_s=None):
    return check.verdicts(SimpleNamespace(voltage_v=cells_v, voltage_age_s=ages_s), total_v)


def test_nothing_is_said_before_anything_was_seen():
    found = verdicts(PlausibilityChecks(team_battery().battery), np.full(96, np.nan))
    assert [check.verdict for check in (found.sum, found.current, found.chips)] == [None, None, None]


def test_current_and_voltage_that_fit_give_the_cells_resistance():
    check = PlausibilityChecks(team_battery().battery)
    found = verdicts(check, drive(check, 300)).current
    assert found.verdict is True
    assert found.value == pytest.approx(RESISTANCE_OHM, rel=0.1)


@pytest.mark.parametrize("resistance_ohm", [0.0, -0.002, 0.05])
def test_current_that_the_voltage_does_not_follow_is_not_believed(resistance_ohm):
    check = PlausibilityChecks(team_battery().battery)
    assert verdicts(check, drive(check, 300, resistance_ohm=resistance_ohm)).current.verdict is False


def test_voltage_that_moves_while_the_current_stands_still_is_not_believed():
    check = PlausibilityChecks(team_battery().battery)
    for i in range(200):
        check.step(DT_S if i else None, 0.0, np.full(96, 3.7 - 0.1 * (i // 10 % 2)), NO_CHIPS)
    assert verdicts(check, np.full(96, 3.7)).current.verdict is False


def test_a_car_that_stands_says_nothing_of_its_current():
    check = PlausibilityChecks(team_battery().battery)
    for i in range(200):
        check.step(DT_S if i else None, 0.3, np.full(96, 3.7), NO_CHIPS)
    assert verdicts(check, np.full(96, 3.7)).current.verdict is None


@pytest.mark.parametrize(("off_v", "verdict"), [(0.04, True), (2.0, False), (-3.7, False)])
def test_sum_of_the_cells_is_held_against_the_total(off_v, verdict):
    cells_v = np.full(96, 3.7)
    found = verdicts(PlausibilityChecks(team_battery().battery), cells_v, total_v=96 * 3.7 + off_v).sum
    assert found.verdict is verdict
    assert found.value == pytest.approx(abs(off_v))


def test_sum_with_a_missing_cell_is_not_judged():
    cells_v = np.full(96, 3.7)
    cells_v[5] = np.nan
    assert verdicts(PlausibilityChecks(team_battery().battery), cells_v, total_v=355.0).sum.verdict is None


def test_a_chip_that_reads_another_cell_voltage_is_named():
    chips_v = np.full(96, 3.72)  # older, at another current: the same for all cells
    good, bad = PlausibilityChecks(team_battery().battery), PlausibilityChecks(team_battery().battery)
    cells_v = drive(good, 100, chips_v=chips_v)
    assert verdicts(good, cells_v).chips.verdict is True
    chips_v[36] += 0.08
    cells_v = drive(bad, 300, chips_v=chips_v)
    found = verdicts(bad, cells_v).chips
    assert (found.verdict, found.cell) == (False, 36)


def test_a_chip_that_was_read_at_another_current_contradicts_nothing():
    rng = np.random.default_rng(3)
    check, joint_ohm, delay = PlausibilityChecks(team_battery().battery), np.zeros(96), 20
    joint_ohm[63] = 0.014
    currents_a = np.repeat(rng.uniform(-40.0, 160.0, 300), 5)
    seen = set()
    for i in range(delay, len(currents_a)):
        cells_v, chips_v = (3.9 - (RESISTANCE_OHM + joint_ohm) * currents_a[k] for k in (i, i - i % 10 - delay))
        check.step(DT_S, currents_a[i], cells_v, chips_v + rng.normal(0, 1e-3, 96))
        seen.add(verdicts(check, cells_v).chips.verdict)
    assert False not in seen


def test_a_chip_has_to_contradict_for_ten_seconds():
    check, chips_v = PlausibilityChecks(team_battery().battery), np.full(96, 3.7)
    chips_v[5] += 0.1
    cells_v = drive(check, 85, chips_v=chips_v)
    assert verdicts(check, cells_v).chips.verdict is None
    assert verdicts(check, drive(check, 30, chips_v=chips_v)).chips.verdict is False


@pytest.mark.parametrize(("oldest_s", "verdict"), [(0.3, False), (5.4, None)])
def test_a_sum_of_voltages_of_other_instants_is_no_contradiction(oldest_s, verdict):
    ages_s = np.linspace(0.0, oldest_s, 96)
    found = verdicts(PlausibilityChecks(team_battery().battery), np.full(96, 3.7), 96 * 3.7 + 40, ages_s)
    assert found.sum.verdict is verdict
