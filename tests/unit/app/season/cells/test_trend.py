"""Lines and steps: bands hold what they say, and steps are told where there are some."""

import numpy as np
import pytest

from app.season.cells.trend import _fit, holm, line, lines, steps, student_95, student_p
from tests.unit.app.season.season_of import season

DAYS = np.sort(np.random.default_rng(7).uniform(0.0, 400.0, 50))
SIGMA = 0.01


def noisy(seed, n_cells, slope=0.0, session=0.0):
    rng = np.random.default_rng(seed)
    values = 1.0 + slope * DAYS[:, None] + SIGMA * rng.standard_normal((len(DAYS), n_cells))
    return values + session * rng.standard_normal((len(DAYS), n_cells)), np.full((len(DAYS), n_cells), SIGMA)


@pytest.mark.parametrize("session", [0.0, 0.02])
def test_the_band_of_a_line_holds_the_slope_as_often_as_it_says(session):
    values, sigmas = noisy(1, 500, slope=1e-4, session=session)
    found = lines(DAYS, values, sigmas)
    inside = np.mean([each.low <= 1e-4 <= each.high for each in found])
    assert inside == pytest.approx(0.95, abs=0.03)


def test_a_line_needs_sessions_at_different_times():
    assert line(DAYS[:4], np.ones(4), np.ones(4)) is None
    assert line(np.zeros(9), np.ones(9), np.ones(9)) is None
    assert line(DAYS, np.full(50, np.nan), np.ones(50)) is None


def test_a_step_is_found_where_it_is_and_with_its_size():
    values, sigmas = noisy(2, 24)
    values[30:, 5] += 0.05
    found = steps(DAYS, values, sigmas)
    assert [k for k, each in enumerate(found) if each is not None] == [5]
    assert abs(found[5].at - 30) <= 2
    assert found[5].low <= 0.05 <= found[5].high


def test_of_many_seasons_without_a_step_about_one_in_twenty_is_given_one():
    false = sum(any(steps(DAYS, *noisy(seed, 8, slope=2e-4, session=0.01))) for seed in range(40))
    assert false <= 6  # 2 are expected; more than 6 happen once in 200


def test_a_missing_measurement_is_no_zero():
    values, sigmas = noisy(3, 2, slope=1e-4)
    values[::3, 1] = np.nan
    full, part = lines(DAYS, values, sigmas)
    assert part.n < full.n
    assert part.now == pytest.approx(full.now, abs=0.01)


def test_student_quantiles_and_holm():
    for freedom, value in ((4, 2.776), (10, 2.228), (30, 2.042)):  # tables
        assert student_95(freedom) == pytest.approx(value, rel=0.004)
    assert holm(np.array([0.01, 0.04, 0.03])).tolist() == pytest.approx([0.03, 0.06, 0.06])


def test_what_bends_as_ageing_does_has_no_step():
    values, sigmas = noisy(9, 24)
    bent = values - 0.06 * np.sqrt(DAYS / DAYS[-1])[:, None]
    assert steps(DAYS, bent, sigmas) == [None] * 24


@pytest.mark.parametrize("t", [0.5, 2.0, 12.7, 300.0])
def test_a_p_value_of_few_sessions_is_never_too_small(t):
    exact = {1.0: 1.0 - 2.0 / np.pi * np.arctan(t), 2.0: 1.0 - t / np.sqrt(2.0 + t**2)}
    for freedom, p in exact.items():
        assert p * 0.99 <= student_p(t**2, freedom) <= 4.0 * p


@pytest.mark.parametrize(("freedom", "quantile"), [(1.0, 12.706), (1.7, 5.132), (2.0, 4.303), (2.8, 3.309)])
def test_bands_of_few_sessions_are_as_wide_as_students(freedom, quantile):
    assert quantile * 0.999 <= student_95(freedom) <= quantile * 1.06


def test_cells_that_age_smoothly_are_seldom_given_a_step():
    found = 0
    for seed in range(40, 45):
        made = season(seed, n_cells=24, n=40, years=0.6)
        truth = np.median(made.capacity[:-1], axis=1)[:, None]
        values = truth + 0.002 * made.rng.standard_normal((40, 8))
        found += sum(each is not None for each in steps(made.days[:-1], values, np.zeros_like(values)))
    assert found <= 10  # of 40; beside the root alone it was half of them


@pytest.mark.parametrize("sigma", [0.0, 0.004, 0.02])
def test_what_sessions_differ_by_leaves_residuals_as_large_as_their_degrees_of_freedom(sigma):
    """Beyond sigmas of any size, each session's own; where the sigmas say more than there is, nothing is added."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        sigmas = sigma * rng.uniform(0.3, 3.0, len(DAYS))
        values = 1.0 + 1e-4 * DAYS + 0.01 * rng.standard_normal(len(DAYS))
        design = np.stack((np.ones_like(DAYS), DAYS - DAYS[-1]), axis=1)
        weights, _, best, residual = _fit(design, values, sigmas)
        squares, freedom = float(weights @ residual**2), len(DAYS) - 2
        assert squares == pytest.approx(freedom, rel=1e-6) or (sigma > 0.0 and squares < freedom)
        if squares < freedom * (1.0 - 1e-6):
            assert weights == pytest.approx(sigmas**-2, rel=1e-6)
        own = np.polynomial.Polynomial.fit(DAYS - DAYS[-1], values, 1, w=np.sqrt(weights)).convert().coef  # numpy's
        assert best == pytest.approx(own, rel=1e-6)
