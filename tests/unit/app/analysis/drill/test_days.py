import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.analysis.drill.days import CHOICES, FIRST_S, LAST_S, POOL, draw_days
from simulator.fault_kinds import FAULTS
from simulator.library import find_scenario


def test_every_fault_of_a_day_is_one_of_the_simulator_on_the_same_target():
    assert {fault: FAULTS[fault].target.value for fault in CHOICES} == CHOICES


@given(st.integers(0, 10**6), st.integers(1, len(POOL)))
def test_a_seed_draws_the_same_days_and_no_fault_twice(seed, n):
    days = draw_days(seed, n)
    assert days == draw_days(seed, n)
    assert len({day.fault for day in days}) == n
    assert [day.number for day in days] == list(range(1, n + 1))


@pytest.mark.parametrize("seed", range(5))
def test_every_day_is_a_scenario_that_the_simulator_plays(seed, tmp_path):
    for day in draw_days(seed, len(POOL)):
        file = tmp_path / "day.toml"
        file.write_text(day.scenario, encoding="utf-8")
        (plan,) = find_scenario(str(file)).faults
        assert plan.name == day.fault
        assert FIRST_S <= plan.at_s <= LAST_S
        assert day.fault not in day.scenario.partition("[[fault]]")[0]  # the title tells nothing


@given(st.integers(0, 10**6))
def test_ten_days_have_something_of_the_car_of_the_bus_and_of_the_charger(seed):
    kinds = {puzzle.fault: puzzle.kind for puzzle in POOL}
    assert {kinds[day.fault] for day in draw_days(seed)} == {"car", "bus", "charger"}


@pytest.mark.parametrize("n", [0, len(POOL) + 1])
def test_no_days_beyond_the_faults_there_are(n):
    with pytest.raises(ValueError, match=str(len(POOL))):
        draw_days(1, n)
