"""Cells age by the calendar and by use, each at its own pace, the same cells at any age."""

import numpy as np
import pytest

from simulator.accumulator import Accumulator, AccumulatorParameters
from simulator.ageing import Ageing, aged
from simulator.scenario import Start

N = 24


def test_a_new_accumulator_is_as_its_factors_say():
    capacity, resistance = aged(Start(capacity_ageing=0.9, resistance_ageing=1.5), N, seed=7)
    assert (capacity == 0.9).all()
    assert (resistance == 1.5).all()


@pytest.mark.parametrize("older", [{"aged_days": 300.0}, {"aged_ah": 900.0}])
def test_time_and_use_cost_every_cell_capacity_and_add_resistance(older):
    young, old = ({name: share * value for name, value in older.items()} for share in (0.5, 1.0))
    (c_young, r_young), (c_old, r_old) = aged(Start(**young), N, seed=7), aged(Start(**old), N, seed=7)
    assert (c_old < c_young).all()
    assert (c_young < 1.0).all()
    assert (r_old > r_young).all()
    assert (r_young > 1.0).all()


def test_it_is_the_law_of_its_source():
    """A mean cell after 300 days at 25 degC and 3.7 V: a_cap t^0.75 by the paper's equation."""
    capacity, _ = aged(Start(aged_days=300.0, aged_degc=25.0, aged_v=3.7), 4000, seed=1)
    rate = (7.543 * 3.7 - 23.75) * 1e6 * np.exp(-6976.0 / 298.15)
    assert np.median(1.0 - capacity) == pytest.approx(rate * 300.0**0.75, rel=0.02)


def test_warmth_and_a_full_charge_age_on_the_shelf():
    plain = aged(Start(aged_days=300.0), N, seed=7)[0]
    assert (aged(Start(aged_days=300.0, aged_degc=40.0), N, seed=7)[0] < plain).all()
    assert (aged(Start(aged_days=300.0, aged_v=4.1), N, seed=7)[0] < plain).all()


def test_a_cell_with_another_pace_ages_faster_and_the_others_do_not():
    plain, faster = (aged(Start(aged_days=200.0, aged_ah=200.0, paces=p), N, seed=7) for p in ({}, {"5": 4.0}))
    lost, more = 1.0 - plain[0], 1.0 - faster[0]
    assert more[5] == pytest.approx(4.0 * lost[5])
    assert np.delete(more, 5) == pytest.approx(np.delete(lost, 5))


def test_beyond_the_law_a_cell_keeps_something():
    assert (aged(Start(aged_days=7300.0, aged_degc=80.0), N, seed=7)[0] >= 0.05).all()


def test_cells_that_age_while_they_run_are_where_the_law_has_them_after_that_time_and_charge():
    """Three hours at 10 mA, so that they neither warm nor empty, at 30,000 times the pace: ten years."""
    times, current_a, hours, paces = 30_000.0, 0.01, 3.0, {"5": 2.0}
    equal = AccumulatorParameters(N, cells_per_pack=N, start_soc_spread=0.0, capacity_spread=0.0, resistance_spread=0.0)
    accumulator = Accumulator(equal, np.random.default_rng(1))
    at = {"aged_degc": 25.0, "aged_v": float(accumulator.ocv_v.mean()), "paces": paces}
    ageing = Ageing(Start(aged_days=100.0, ageing=times, **at), accumulator, seed=7)
    for now_s in np.arange(10.0, 3600.0 * hours + 1.0, 10.0):
        accumulator.step(10.0, current_a)
        ageing.step(now_s)
    accumulator.step(1.0, 0.0)
    years = Start(aged_days=100.0 + times * hours / 24.0, aged_ah=times * current_a * hours, **at)
    capacity, _ = aged(years, N, seed=7)
    assert accumulator.capacity_ah / equal.cell.capacity_ah == pytest.approx(capacity, rel=2e-3)
