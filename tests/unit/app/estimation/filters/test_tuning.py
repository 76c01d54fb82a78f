import inspect
import re
from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.estimation.filters.tuning import Tuning

TUNING = Tuning()


@given(st.floats(0.1, 100.0), st.integers(1, 50))
def test_more_samples_of_the_same_seconds_tell_no_more(dt_s, parts):
    """Information per second: samples a second over the variance of one."""
    once, often = (1.0 / (dt * TUNING.correlation_factor(dt)) for dt in (dt_s, dt_s / parts))
    assert often == pytest.approx(1.0 / (dt_s / parts + 2.0 * TUNING.correlation_s), rel=0.05)
    assert once <= often <= 1.0 / (2.0 * TUNING.correlation_s) * 1.01


def test_samples_far_apart_are_taken_for_independent():
    assert TUNING.correlation_factor(1e6) == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize("dt_s", [0.0, 1e-12])
def test_two_samples_of_one_instant_have_a_finite_variance(dt_s):
    assert np.isfinite(TUNING.correlation_factor(dt_s))


@given(st.lists(st.floats(-1.0, 1.0), min_size=2, max_size=8))
def test_the_model_is_trusted_less_the_more_it_drops_in_either_direction(drops_v):
    drop_v = np.array(drops_v)
    variance = TUNING.voltage_variance(drop_v)
    assert (variance >= TUNING.model_error_v**2).all()
    np.testing.assert_array_equal(variance, TUNING.voltage_variance(-drop_v))
    order = np.argsort(np.abs(drop_v))
    assert (np.diff(variance[order]) >= 0.0).all()


def test_there_are_no_more_constants_than_were_measured_and_each_says_what_it_rests_on():
    source = inspect.getsource(Tuning)
    assert len(fields(Tuning)) <= 44
    for field in fields(Tuning):
        assert re.search(rf"^    {field.name}: float = [\d.e-]+  # \S", source, re.MULTILINE), field.name
