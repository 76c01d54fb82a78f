import numpy as np
import pytest

from app.estimation.errors import ShapeError
from app.estimation.filters.estimates import OUT_OCV, OUT_VOLTAGE, Estimates
from app.estimation.health.resistance_scale import PRIOR_SIGMA, ResistanceScale, filter_factor, shared_factor

GROWN = np.array([1.0, 1.4, 0.9, 1.15])
DT_S = 0.1


def said(ocv_v, model_v):
    """Estimates of four cells that have such an OCV and terminal voltage."""
    numbers = np.zeros((8, 4))
    numbers[OUT_OCV], numbers[OUT_VOLTAGE] = ocv_v, model_v
    return Estimates(numbers)


def driven(scale, seconds, seed=1, slow_error_v=0.0, missing=()):
    """Laps of 20 s on an OCV that falls slowly; the cells resist GROWN times 2 mohm, the model 2 mohm."""
    rng = np.random.default_rng(seed)
    for k in range(round(seconds / DT_S)):
        t = k * DT_S
        current = 80.0 + 70.0 * np.sin(2 * np.pi * t / 20.0) + 30.0 * np.sign(np.sin(2 * np.pi * t / 3.0))
        ocv = 3.9 - 1e-4 * t
        volts = ocv + slow_error_v * np.sin(2 * np.pi * t / 600.0) - 2e-3 * GROWN * current
        volts = volts + 1.2e-3 * rng.normal(size=4)
        volts[list(missing)] = np.nan
        scale.step(DT_S, said(ocv, ocv - 2e-3 * current), np.ones(4), volts)
    return scale


def test_growth_is_found_and_sigma_covers_the_error():
    scale = driven(ResistanceScale(4), 120.0)
    np.testing.assert_allclose(scale.judge()[0], GROWN, atol=0.02)
    assert (np.abs(scale.judge()[0] - GROWN) < 3.0 * scale.judge()[1]).all()
    assert (scale.judge()[1] < 0.05).all()


def test_a_slow_error_of_the_soc_is_not_taken_for_resistance():
    np.testing.assert_allclose(driven(ResistanceScale(4), 300.0, slow_error_v=0.05).judge()[0], GROWN, atol=0.05)


def test_nothing_is_claimed_before_driving():
    scale = ResistanceScale(4)
    for _ in range(600):
        scale.step(DT_S, said(3.9, 3.9), np.ones(4), np.full(4, 3.8))
    np.testing.assert_allclose(scale.judge()[0], 1.0)
    np.testing.assert_allclose(scale.judge()[1], PRIOR_SIGMA, rtol=0.01)


def test_a_rest_forgets_nothing():
    scale = driven(ResistanceScale(4), 120.0)
    before = scale.judge()[0]
    for _ in range(36_000):
        scale.step(DT_S, said(3.9, 3.9), np.ones(4), np.full(4, 3.9))
    np.testing.assert_allclose(scale.judge()[0], before, atol=0.01)


def test_a_cell_without_a_voltage_says_nothing_and_disturbs_none():
    scale = driven(ResistanceScale(4), 120.0, missing=(2,))
    assert scale.judge()[1][2] == pytest.approx(PRIOR_SIGMA, rel=0.01)
    np.testing.assert_allclose(scale.judge()[0][[0, 1, 3]], GROWN[[0, 1, 3]], atol=0.02)
    assert np.isfinite(driven(scale, 60.0, seed=2).judge()[0]).all()


def test_a_gap_and_a_failed_measurement_are_no_drop():
    scale = driven(ResistanceScale(4), 120.0)
    scale.step(600.0, said(3.5, 3.5), np.ones(4), np.full(4, 3.45))
    scale.step(DT_S, said(3.5, 3.3), np.ones(4), np.zeros(4))
    np.testing.assert_allclose(scale.judge()[0], GROWN, atol=0.02)


def test_wrong_shape_is_refused():
    with pytest.raises(ShapeError, match="voltages_v"):
        ResistanceScale(4).step(DT_S, said(0.0, 0.0), np.ones(4), np.zeros(3))


def test_the_next_session_begins_with_what_the_last_one_found_and_learns_on():
    before = driven(ResistanceScale(4), 300.0)
    after = ResistanceScale(4, np.array(before.judge()))
    np.testing.assert_allclose(after.judge()[0], before.judge()[0])
    assert (after.judge()[1] > before.judge()[1]).all(), "temperature and age may have changed it"
    assert (after.judge()[1] < 0.08).all(), "well enough known to be counted with at once"
    warmer = ResistanceScale(4, np.array((1.3 * GROWN, before.judge()[1])))
    np.testing.assert_allclose(driven(warmer, 300.0).judge()[0], GROWN, atol=0.03)


def test_a_past_that_cannot_be_is_none():
    absurd = np.array([[np.nan, -1.0, 1e6, 1.0], [0.01, 0.01, 0.01, np.nan]])
    np.testing.assert_allclose(ResistanceScale(4, absurd).judge()[0], 1.0)
    np.testing.assert_allclose(ResistanceScale(4, absurd).judge()[1], PRIOR_SIGMA)
    np.testing.assert_allclose(ResistanceScale(4, np.ones((2, 3))).judge()[0], 1.0)


def test_growth_is_believed_and_what_a_circuit_cannot_tell_is_not():
    np.testing.assert_allclose(shared_factor(np.array([0.93, 1.0, 1.1])), 1.0, atol=0.008)
    np.testing.assert_allclose(shared_factor(np.array([0.78])), 1.0, atol=0.02)  # age makes no cell resist less
    np.testing.assert_allclose(shared_factor(np.array([0.4, 1.6, 2.5])), [0.4, 1.6, 2.5], atol=0.03)
    assert (np.diff(shared_factor(np.linspace(0.3, 3.0, 200))) > 0.0).all()


def test_a_factor_below_one_is_believed_later_than_one_above():
    growth = np.linspace(0.01, 0.6, 60)
    believed_more, believed_less = shared_factor(1.0 + growth) - 1.0, 1.0 - shared_factor(1.0 - growth)
    assert (believed_less < believed_more).all()
    assert (np.diff(believed_more) > 0.0).all()
    assert (np.diff(believed_less) > 0.0).all()
    assert believed_more[-1] > 0.95 * growth[-1]


def test_what_cells_share_is_left_to_the_model_and_what_they_differ_by_is_used_whole():
    ratio = np.array([0.86, 0.95, 1.0, 1.07, 1.14])
    known = np.full(5, True)
    np.testing.assert_allclose(filter_factor(1.12 * ratio, known), ratio, atol=0.02)
    np.testing.assert_allclose(filter_factor(1.7 * ratio, known), shared_factor(1.7) * ratio, atol=1e-12)
    np.testing.assert_allclose(filter_factor(np.array([1.12]), known[:1]), 1.0, atol=0.01)  # one cell differs from none


def test_a_cell_of_which_nothing_is_known_is_like_the_others():
    factor = np.array([1.7, 1.0, 1.7, 9.0])
    found = filter_factor(factor, np.array([True, False, True, False]))
    np.testing.assert_allclose(found, shared_factor(1.7))
    np.testing.assert_allclose(filter_factor(factor, np.full(4, False)), 1.0)
