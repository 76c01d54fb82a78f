"""Lines: bands hold what they say."""

import numpy as np
import pytest
from scipy import stats

from app.season.trends import line, lines

DAYS = np.sort(np.random.default_rng(7).uniform(0.0, 400.0, 50))
SIGMA = 0.01


def noisy(seed, n_cells, slope=0.0, session=0.0, sigma=SIGMA):
    rng = np.random.default_rng(seed)
    sigmas = np.broadcast_to(sigma, (len(DAYS), n_cells))
    values = 1.0 + slope * DAYS[:, None] + sigmas * rng.standard_normal((len(DAYS), n_cells))
    return values + session * rng.standard_normal((len(DAYS), n_cells)), sigmas


def holds(found, slope):
    return np.mean([each.low <= slope <= each.high for each in found])


@pytest.mark.parametrize("session", [0.0, 0.02])
def test_the_band_of_a_line_holds_the_slope_as_often_as_it_says(session):
    values, sigmas = noisy(1, 500, slope=1e-4, session=session)
    found = lines(DAYS, values, sigmas)
    assert holds(found, 1e-4) == pytest.approx(0.95, abs=0.03)
    inside = [abs(each.at(DAYS[[10]])[0] - 1.0 - 1e-4 * DAYS[10]) <= each.at(DAYS[[10]])[1] for each in found]
    assert np.mean(inside) == pytest.approx(0.95, abs=0.03)


def test_a_session_that_was_measured_well_counts_more_as_far_as_sessions_agree():
    """Ten times as well in every other one: the band is that of these where nothing else differs, and as wide as chance
    makes it where sessions differ by more than all were measured with."""
    uneven = np.where(np.arange(len(DAYS)) % 2, SIGMA, SIGMA / 10)[:, None]
    agreeing, differing = (
        lines(DAYS, *noisy(2, 500, slope=1e-4, session=session, sigma=uneven)) for session in (0.0, 0.03)
    )
    assert holds(agreeing, 1e-4) == pytest.approx(0.95, abs=0.03)
    assert holds(differing, 1e-4) == pytest.approx(0.95, abs=0.03)
    alike = lines(DAYS, *noisy(2, 500, slope=1e-4))
    assert np.mean([each.high - each.low for each in agreeing]) < 0.5 * np.mean(
        [each.high - each.low for each in alike]
    )


def test_a_line_of_sessions_measured_alike_is_the_regression_of_scipy():
    values = noisy(3, 1, slope=1e-4)[0][:, 0]
    found, own = line(DAYS, values, np.zeros(len(DAYS))), stats.linregress(DAYS, values)
    reach = stats.t.ppf(0.975, len(DAYS) - 2) * own.stderr
    assert (found.per_day, found.low, found.high) == pytest.approx(
        (own.slope, own.slope - reach, own.slope + reach), rel=1e-6
    )
    assert found.now == pytest.approx(own.intercept + own.slope * DAYS[-1])


def test_a_line_needs_sessions_at_different_times():
    assert line(DAYS[:4], np.ones(4), np.ones(4)) is None
    assert line(np.zeros(9), np.ones(9), np.ones(9)) is None
    assert line(DAYS, np.full(50, np.nan), np.ones(50)) is None


def test_a_missing_measurement_is_no_zero():
    values, sigmas = noisy(3, 2, slope=1e-4)
    values[::3, 1] = np.nan
    full, part = lines(DAYS, values, sigmas)
    assert part.n < full.n
    assert part.now == pytest.approx(full.now, abs=0.01)
