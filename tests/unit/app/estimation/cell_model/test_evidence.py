import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.estimation.cell_model.evidence import HELD_S, Evidence, held_currents, sand_current_a

PULSE = held_currents([(np.arange(0.0, 2000.0), np.clip(np.arange(0.0, 2000.0) - 100.0, 0.0, 10.0) * 6.0 / 3600.0)])


def test_a_pulse_was_held_as_long_as_it_lasted_and_less_as_a_mean_over_longer():
    held = dict(PULSE)
    assert [held[seconds] for seconds in (1.0, 3.0, 10.0)] == pytest.approx([6.0, 6.0, 6.0])
    assert held[100.0] == pytest.approx(0.6)


def test_the_largest_of_all_recordings_counts_in_either_direction():
    time_s = np.arange(0.0, 2000.0)
    charged = (time_s, -3.0 * time_s / 3600.0)
    driven = (time_s, 2.0 * time_s / 3600.0)
    assert dict(held_currents([driven, charged])) == pytest.approx(dict.fromkeys(HELD_S, 3.0))


def test_another_time_counts_with_the_root_of_the_times_and_a_mean_over_long_not_for_shorter():
    assert sand_current_a(((10.0, 6.0),), np.array([2.5, 10.0, 40.0])) == pytest.approx([12.0, 6.0, 3.0])
    assert sand_current_a(((40.0, 6.0),), np.array([2.5, 40.0, 90.0])) == pytest.approx([6.0, 6.0, 4.0])


@given(st.lists(st.floats(0.1, 100.0), min_size=len(HELD_S), max_size=len(HELD_S)), st.floats(0.0, 5000.0))
def test_nothing_is_held_longer_than_what_is_held_shorter(amps, time_s):
    held = tuple(zip(HELD_S, amps, strict=True))
    assert sand_current_a(held, 2.0 * time_s) <= sand_current_a(held, time_s)
    assert sand_current_a(held, 0.0) >= max(amps)


def test_without_a_word_about_currents_none_is_beyond():
    np.testing.assert_array_equal(sand_current_a((), np.array([1.0, 30.0])), np.inf)


def test_an_error_is_that_of_all_times_what_soc_current_and_temperature_change():
    by_c, by_soc = ((0.0, 0.01), (4.0, 0.03)), ((0.1, 0.05), (0.5, 0.02))
    evidence = Evidence(by_soc=by_soc, by_c=by_c, by_degc=((25.0, 0.01),))
    found_v = evidence.error_v(0.02, np.array([0.1, 0.5, 0.5]), np.array([4.0, -4.0, 0.0]), 25.0)
    assert found_v == pytest.approx([0.02 * 2.5 * 1.5 * 0.5, 0.02 * 1.5 * 0.5, 0.5 * 0.02])
    assert Evidence().error_v(0.02, 0.5, 1.0, 25.0) == 0.02
