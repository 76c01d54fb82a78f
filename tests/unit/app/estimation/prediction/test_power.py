from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.cell_model.evidence import Evidence
from app.estimation.errors import ModelError, ShapeError
from app.estimation.prediction.constant_current import CellKnowledge, Limits, OperatingPoint
from app.estimation.prediction.power import PowerModel
from tests.open_loop import simulate

CELL = load_cell("samsung-25r-10p")
MEASURED = replace(CELL, fit_current_max_a=1000.0)
SEEN = replace(CELL, evidence=Evidence(held=((1.0, 150.0), (10.0, 150.0), (100.0, 50.0))))
WIDE = Limits(discharge_max_a=5000.0, charge_max_a=5000.0, temperature_max_degc=1e6, v_min_v=2.5, v_max_v=4.2)


def states(soc=0.5, degc=25.0, n=96):
    soc = np.broadcast_to(np.asarray(soc, dtype=float), (n,)).copy()
    return OperatingPoint(soc, np.zeros((CELL.n_rc, n)), np.broadcast_to(np.asarray(degc, dtype=float), (n,)).copy())


def state_of_power(model, cells):
    return model.predict(cells, ())[0]


def times_to_trip(model, cells, current_a):
    return model.predict(cells, (current_a,), ())[1][0]


def driven(soc, current_a, seconds, degc=25.0):
    """Return voltage and SOC after a constant current, stepped by the circuit itself."""
    time_s = np.linspace(0.0, seconds, 200)
    current = np.full(200, current_a)
    z, v = simulate(CELL, time_s, current, np.full(200, degc), soc)
    return v[-1], z[-1]


@pytest.mark.parametrize("horizon", [0, 1, 2])
def test_discharge_power_ends_at_the_lowest_voltage(horizon):
    found = state_of_power(PowerModel(MEASURED, WIDE), states(0.3)).discharge[horizon]
    voltage, _ = driven(0.3, found.current_a, found.horizon_s)
    assert voltage == pytest.approx(2.5, abs=0.03)
    assert found.reason == "voltage"
    assert found.power_w == pytest.approx(96 * voltage * found.current_a, rel=0.02)


def test_charge_power_ends_at_the_highest_voltage():
    found = state_of_power(PowerModel(CELL, WIDE), states(0.8)).charge[1]
    voltage, _ = driven(0.8, -found.current_a, 10.0)
    assert voltage == pytest.approx(4.2, abs=0.02)
    assert found.reason == "voltage"


def test_longer_means_less():
    found = state_of_power(PowerModel(CELL, WIDE), states(0.4))
    for side in (found.discharge, found.charge):
        assert side[0].power_w > side[1].power_w > side[2].power_w


def test_current_limit_names_no_cell():
    found = state_of_power(PowerModel(CELL, Limits(discharge_max_a=100.0)), states(0.7)).discharge[0]
    assert (found.current_a, found.cell, found.reason) == (100.0, None, "current")


def test_weakest_cell_limits():
    soc = np.full(96, 0.5)
    soc[37] = 0.12
    found = state_of_power(PowerModel(CELL, WIDE), states(soc))
    assert found.discharge[2].cell == 37
    factor = np.ones(96)
    factor[11] = 2.0
    assert (
        state_of_power(PowerModel(CELL, WIDE, CellKnowledge(resistance_factor=factor)), states(0.5)).discharge[0].cell
        == 11
    )


def test_charge_left_in_the_cell_limits_the_long_horizon():
    limits = Limits(discharge_max_a=300.0, soc_min=0.495, v_min_v=0.1, temperature_max_degc=1e6)
    found = state_of_power(PowerModel(CELL, limits), states(0.5)).discharge
    assert found[0].reason == "current"
    assert found[2].reason == "soc"
    assert found[2].current_a == pytest.approx(0.005 * CELL.capacity_ah * 3600 / 30, rel=0.01)


def test_hot_cell_limits_by_its_temperature():
    degc = np.full(96, 40.0)
    degc[5] = 59.5
    found = state_of_power(PowerModel(CELL, Limits()), states(0.9, degc)).discharge[2]
    assert (found.cell, found.reason) == (5, "temperature")
    degc[5] = 61.0
    assert state_of_power(PowerModel(CELL, Limits()), states(0.9, degc)).discharge[0].current_a == pytest.approx(
        0, abs=0.1
    )


def test_missing_cell_is_left_out():
    soc = np.full(96, 0.5)
    soc[0] = np.nan
    found = state_of_power(PowerModel(CELL, WIDE), states(soc)).discharge[0]
    assert found.power_w == pytest.approx(95 * 2.5 * found.current_a, rel=0.02)
    with pytest.raises(ModelError):
        state_of_power(PowerModel(CELL, WIDE), states(np.full(96, np.nan)))


def test_history_of_the_pair_counts():
    fresh, tired = states(0.3), states(0.3)
    tired.branch_a[:] = 150.0
    model = PowerModel(CELL, WIDE)
    assert state_of_power(model, tired).discharge[0].power_w < state_of_power(model, fresh).discharge[0].power_w


def test_time_to_empty_is_charge_over_current():
    trips = {t.limit: t for t in times_to_trip(PowerModel(CELL, WIDE), states(0.2), CELL.capacity_ah)}
    assert trips["soc_min"].seconds == pytest.approx(720.0, abs=0.5)
    assert trips["temperature_max"].seconds == np.inf
    assert trips["temperature_max"].cell is None


def test_voltage_trip_comes_when_the_circuit_says():
    soc = np.full(96, 0.6)
    soc[70] = 0.25
    trip = times_to_trip(PowerModel(CELL, WIDE), states(soc), 200.0)[0]
    assert (trip.limit, trip.cell) == ("v_min", 70)
    assert driven(0.25, 200.0, trip.seconds)[0] == pytest.approx(2.5, abs=0.04)


def test_charging_meets_the_upper_limits():
    trips = {t.limit: t for t in times_to_trip(PowerModel(CELL, WIDE), states(0.9), -25.0)}
    assert set(trips) == {"v_max", "soc_max", "temperature_max"}
    assert trips["soc_max"].seconds == pytest.approx(360.0, rel=0.02)
    assert trips["v_max"].seconds <= trips["soc_max"].seconds


def test_limit_already_passed_is_now():
    trips = times_to_trip(PowerModel(CELL, Limits(temperature_max_degc=20.0)), states(0.5), 10.0)
    assert trips[2].seconds == 0.0


def test_states_of_another_shape_are_refused():
    bad = OperatingPoint(np.full(96, 0.5), np.zeros((CELL.n_rc, 95)), np.full(96, 25.0))
    with pytest.raises(ShapeError):
        PowerModel(CELL, WIDE).ahead(bad, np.array(1.0), np.array(1.0))


def test_a_small_cell_is_the_first_to_be_empty():
    capacity = np.full(96, CELL.capacity_ah)
    capacity[40] *= 0.7
    model = PowerModel(CELL, Limits(soc_min=0.1), CellKnowledge(capacity_ah=capacity))
    trip = {trip.limit: trip for trip in times_to_trip(model, states(0.4), 50.0)}["soc_min"]
    assert trip.cell == 40
    assert trip.seconds == pytest.approx(0.3 * 0.7 * CELL.capacity_ah * 3600 / 50.0, rel=0.01)


def test_asked_together_or_alone_the_answers_are_the_same():
    rng = np.random.default_rng(5)
    cells = states(rng.uniform(0.3, 0.6, 96), 30.0)
    factor, capacity_ah = rng.uniform(0.9, 1.4, 96), CELL.capacity_ah * rng.uniform(0.9, 1.0, 96)
    model = PowerModel(CELL, WIDE, CellKnowledge(resistance_factor=factor, capacity_ah=capacity_ah))
    power, trips = model.predict(cells, (40.0, -25.0))
    alone = state_of_power(model, cells)
    for one, other in zip(power.discharge + power.charge, alone.discharge + alone.charge, strict=True):
        assert (one.cell, one.reason) == (other.cell, other.reason)
        assert one.current_a == pytest.approx(other.current_a, abs=WIDE.discharge_max_a / 4096)
    for found, current_a in zip(trips, (40.0, -25.0), strict=True):
        for one, other in zip(found, times_to_trip(model, cells, current_a), strict=True):
            assert (one.limit, one.cell) == (other.limit, other.cell)
            assert one.seconds == pytest.approx(other.seconds, abs=3600.0 / 4096)


def test_at_the_largest_current_every_cell_keeps_its_limits_and_a_little_more_passes_one():
    rng = np.random.default_rng(6)
    cells = states(rng.uniform(0.3, 0.6, 96), 30.0)
    model = PowerModel(CELL, WIDE, CellKnowledge(resistance_factor=rng.uniform(0.9, 1.4, 96)))
    for limit in state_of_power(model, cells).discharge:
        within = model.ahead(cells, np.array(limit.current_a), np.array(limit.horizon_s))[0]
        more = np.array(limit.current_a + WIDE.discharge_max_a / 8192)
        beyond = model.ahead(cells, more, np.array(limit.horizon_s))[0]
        assert limit.reason == "voltage"
        assert within.min() >= WIDE.v_min_v > beyond.min()
        assert beyond.argmin() == limit.cell


def test_the_band_widens_with_what_is_not_known():
    def width(known):
        limit = state_of_power(PowerModel(MEASURED, WIDE, known), states(0.3)).discharge[1]
        assert limit.low_w < limit.power_w < limit.high_w
        return limit.high_w - limit.low_w

    least = width(CellKnowledge())
    assert width(CellKnowledge(soc_sigma=np.full(96, 0.03))) > least
    assert width(CellKnowledge(resistance_sigma=np.full(96, 0.2))) > 1.5 * least


def test_times_have_a_band_that_may_reach_beyond_the_hour():
    known = CellKnowledge(soc_sigma=np.full(96, 0.02), capacity_sigma_frac=0.02)
    trip = {t.limit: t for t in times_to_trip(PowerModel(CELL, WIDE, known), states(0.5), 0.51 * CELL.capacity_ah)}[
        "soc_min"
    ]
    assert trip.low_s < trip.seconds < 3600.0 < trip.high_s
    assert trip.low_s == pytest.approx(trip.seconds - 1.645 * 3600 * np.hypot(0.02, 0.01) / 0.51, rel=0.01)


def test_beyond_the_measured_currents_the_band_ends_where_the_model_does_and_reaches_lower():
    beyond = replace(CELL, fit_current_max_a=50.0)
    one, other = (state_of_power(PowerModel(cell, WIDE), states(0.5)).discharge[0] for cell in (MEASURED, beyond))
    assert (one.beyond_measured, other.beyond_measured) == (False, True)
    assert (one.measured_a, other.measured_a) == (1000.0, 50.0)
    assert 50.0 < other.current_a < one.current_a
    assert other.low_w < other.power_w < one.low_w
    assert one.power_w < other.high_w < 1.25 * one.high_w
    not_encoded = state_of_power(PowerModel(replace(CELL, fit_current_max_a=0.0), WIDE), states(0.5))
    assert not_encoded.discharge[0].beyond_measured is None
    assert not_encoded.discharge[0].measured_a is None


@given(st.floats(0.1, 0.95), st.floats(-10.0, 45.0), st.floats(0.0, 0.05), st.floats(2.0, 3.2), st.floats(0.0, 0.5))
def test_a_band_holds_its_median_and_a_stricter_limit_leaves_less(soc, degc, soc_sigma, v_min_v, stricter_v):
    known = CellKnowledge(soc_sigma=np.full(1, soc_sigma))
    one, other = (
        state_of_power(PowerModel(SEEN, replace(WIDE, v_min_v=v), known), states(soc, degc, 1)).discharge
        for v in (v_min_v, v_min_v + stricter_v)
    )
    for loose, strict in zip(one, other, strict=True):
        assert loose.low_w <= loose.power_w <= loose.high_w
        assert strict.current_a <= loose.current_a
        assert strict.measured_a == loose.measured_a


@given(st.floats(0.2, 0.9), st.floats(0.1, 0.9))
def test_the_fewer_currents_were_measured_the_wider_the_band_downwards(soc, share):
    held = tuple((seconds, share * amps) for seconds, amps in SEEN.evidence.held)
    fewer = replace(SEEN, evidence=Evidence(held=held))
    one, other = (state_of_power(PowerModel(cell, WIDE), states(soc, n=1)).discharge for cell in (SEEN, fewer))
    for more, less in zip(one, other, strict=True):
        assert less.measured_a <= more.measured_a
        assert less.low_w <= more.low_w
        assert less.power_w <= more.power_w
        if less.beyond_measured:
            assert less.low_w < less.power_w


def test_a_temperature_that_was_never_measured_widens_the_band_and_is_marked():
    everywhere = replace(MEASURED, fit_temperature_degc=np.array([-10.0, 0.0, 25.0]))
    warm_alone = replace(MEASURED, fit_temperature_degc=np.array([25.0]))
    one, other = (
        state_of_power(PowerModel(c, WIDE), states(0.5, -10.0)).discharge[0] for c in (everywhere, warm_alone)
    )
    assert (one.beyond_measured, other.beyond_measured) == (False, True)
    assert other.low_w < one.low_w < one.high_w < other.high_w


def test_a_time_to_a_limit_is_marked_where_its_current_was_never_measured_for_so_long():
    _, (within, beyond) = PowerModel(SEEN, WIDE).predict(states(0.5), (40.0, 120.0))
    assert [trip.beyond_measured for trip in within] == [False, None, False]
    assert [trip.beyond_measured for trip in beyond] == [True, None, True]
