import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from app.estimation.cell_model.ocv import (
    OCV_METHODS,
    OcvCurve,
    from_rests,
    from_two_currents,
    monotone_slopes,
    zero_phase_lowpass,
)
from app.estimation.errors import ModelError
from tests.campaign import examples

SOC = np.linspace(0.0, 1.0, 41)
VOLTS = 3.2 + 0.8 * SOC + 0.1 * np.tanh((SOC - 0.5) * 8.0) - 0.15 * np.exp(-SOC * 30.0)


@pytest.mark.parametrize("method", OCV_METHODS)
def test_every_method_follows_a_smooth_curve(method):
    curve = OcvCurve(SOC, VOLTS, method)
    inside = np.linspace(0.1, 0.9, 97)
    truth = 3.2 + 0.8 * inside + 0.1 * np.tanh((inside - 0.5) * 8.0) - 0.15 * np.exp(-inside * 30.0)
    assert np.abs(curve.voltage(inside) - truth).max() < 5e-3


@pytest.mark.parametrize("method", ["interpolation", "polynomial"])
def test_slope_is_the_derivative_of_the_value(method):
    curve = OcvCurve(SOC, VOLTS, method)
    at = np.linspace(0.013, 0.987, 50)
    numeric = (curve.voltage(at + 1e-6) - curve.voltage(at - 1e-6)) / 2e-6
    np.testing.assert_allclose(curve.slope(at), numeric, rtol=1e-4, atol=1e-4)


def test_smoothed_slope_has_no_steps_where_straight_lines_have():
    rng = np.random.default_rng(2)
    noisy = np.maximum.accumulate(VOLTS + rng.normal(0.0, 2e-3, VOLTS.size))
    fine = np.linspace(0.2, 0.95, 400)
    rough = np.gradient(np.interp(fine, SOC, noisy), fine)
    smooth = OcvCurve(SOC, noisy, "smoothed").slope(fine)
    assert np.abs(np.diff(smooth)).max() < 0.25 * np.abs(np.diff(rough)).max()


def test_interpolation_never_falls_between_points_that_do_not():
    curve = OcvCurve([0.0, 0.1, 0.2, 0.21, 0.9, 1.0], [3.0, 3.3, 3.3, 3.6, 3.61, 4.2])
    assert (np.diff(curve.voltage(np.linspace(0.0, 1.0, 2001))) >= -1e-12).all()


@pytest.mark.parametrize("method", OCV_METHODS)
def test_outside_the_measured_range_the_curve_is_a_straight_rising_line(method):
    curve = OcvCurve(SOC * 0.8 + 0.1, VOLTS, method)
    below, above = curve.voltage([-0.1, 0.0, 0.1]), curve.voltage([0.9, 1.0, 1.1])
    assert below[1] - below[0] == pytest.approx(below[2] - below[1])
    assert above[1] - above[0] == pytest.approx(above[2] - above[1])
    assert below[0] < below[2] < above[0] < above[2]
    assert curve.soc_range == pytest.approx((0.1, 0.9))


def test_inverse_returns_the_soc_and_stops_just_past_the_ends():
    curve = OcvCurve(SOC, VOLTS)
    at = np.linspace(0.02, 0.98, 33)
    np.testing.assert_allclose(curve.soc_at(curve.voltage(at)), at, atol=2e-4)
    assert curve.soc_at(0.0) == -0.05
    assert curve.soc_at(9.0) == 1.05
    assert np.isnan(curve.soc_at(np.nan))


def test_rests_at_the_same_soc_are_averaged():
    curve = from_rests([0.9, 0.5, 0.5001, 0.1], [4.0, 3.70, 3.72, 3.4])
    assert curve.voltage(0.50005) == pytest.approx(3.71)


def test_two_discharge_currents_extrapolate_to_none():
    curve = from_two_currents(SOC, VOLTS - 25.0 * 2e-3, VOLTS - 250.0 * 2e-3, 25.0, 250.0)
    np.testing.assert_allclose(curve.voltage(SOC), VOLTS, atol=1e-9)
    with pytest.raises(ModelError, match="same current"):
        from_two_currents(SOC, VOLTS, VOLTS, 5.0, 5.0)


@pytest.mark.parametrize(
    ("soc", "volts", "method", "field"),
    [
        ([0.0, 1.0], [3.0, 4.0], "spline", "ocv.method"),
        ([0.0], [3.0], "interpolation", "ocv.voltage_v"),
        ([0.0, 1.0], [3.0, np.nan], "interpolation", "ocv.voltage_v"),
        ([0.5, 0.5], [3.0, 4.0], "interpolation", "ocv.soc"),
        ([0.0, 1.2], [3.0, 4.0], "interpolation", "ocv.soc"),
        ([0.0, 1.0], [4.0, 3.0], "interpolation", "ocv.voltage_v"),
    ],
)
def test_points_that_are_no_curve_are_refused_by_name(soc, volts, method, field):
    with pytest.raises(ModelError) as caught:
        OcvCurve(soc, volts, method)
    assert caught.value.field == field


def test_forward_backward_filter_shifts_nothing_and_passes_a_line():
    line = np.linspace(-3.0, 5.0, 301)
    np.testing.assert_allclose(zero_phase_lowpass(line, 0.1), line, atol=1e-9)
    wave = np.cos(2 * np.pi * np.arange(601) / 200.0)
    passed = zero_phase_lowpass(wave, 0.1)
    assert np.argmax(passed[150:250]) == np.argmax(wave[150:250])


PLATEAU = np.interp(SOC, [0.0, 0.1, 0.35, 0.65, 1.0], [2.9, 3.2, 3.29, 3.295, 3.4])  # OCV of an LFP cell


@pytest.mark.parametrize("volts", [VOLTS, PLATEAU], ids=["NMC", "LFP"])
def test_interpolation_meets_every_measured_point(volts):
    curve = OcvCurve(SOC, volts)
    assert curve.voltage(SOC) == pytest.approx(volts, abs=1e-12)
    assert curve.soc_range == (0.0, 1.0)


@pytest.mark.parametrize("volts", [VOLTS, PLATEAU], ids=["NMC", "LFP"])
@pytest.mark.parametrize("method", OCV_METHODS)
def test_a_higher_voltage_never_means_a_lower_soc_and_leads_back_to_itself(method, volts):
    curve = OcvCurve(SOC, volts, method)
    asked = np.linspace(volts[0], volts[-1], 301)
    soc = curve.soc_at(asked)
    assert (np.diff(soc) >= 0.0).all()
    rising = curve.slope(soc) > 0.0  # a polynomial may fall a little on a plateau
    assert np.abs(curve.voltage(soc) - asked)[rising].max() < 5e-3


def test_a_voltage_that_is_missing_has_no_soc_and_the_others_keep_theirs():
    curve = OcvCurve(SOC, VOLTS)
    found = curve.soc_at(np.array([[VOLTS[10], np.nan], [np.nan, VOLTS[30]]]))
    assert found == pytest.approx(np.array([[SOC[10], np.nan], [np.nan, SOC[30]]]), abs=1e-3, nan_ok=True)


def test_rests_that_noise_lets_fall_make_no_falling_curve():
    noisy = VOLTS + np.where(np.arange(SOC.size) % 2, -0.03, 0.0)
    curve = from_rests(SOC, noisy)
    assert (np.diff(curve.voltage(np.linspace(0.0, 1.0, 501))) >= -1e-12).all()


def test_a_curve_does_not_follow_what_becomes_of_the_arrays_that_it_was_made_of():
    soc, volts = SOC.copy(), VOLTS.copy()
    curve = OcvCurve(soc, volts)
    before = curve.voltage(0.5)
    soc[:], volts[:] = 0.0, 0.0
    assert curve.voltage(0.5) == before
    assert curve.soc[-1] == 1.0


points = st.lists(st.tuples(st.floats(0.01, 0.3), st.floats(0.0, 0.4)), min_size=1, max_size=12)


def rising(steps):
    """SOC inside 0..1 and voltages that never fall, from steps of both."""
    soc = np.concatenate(([0.0], np.cumsum([step for step, _ in steps])))
    volts = 3.0 + np.concatenate(([0.0], np.cumsum([step for _, step in steps])))
    volts[-1] += 0.01
    return soc / soc[-1], volts


@settings(max_examples=examples(100), deadline=None)
@given(points)
def test_the_monotone_curve_stays_between_its_points_whatever_they_are(steps):
    soc, volts = rising(steps)
    curve = OcvCurve(soc, volts)
    at = np.linspace(0.0, 1.0, 401)
    found = curve.voltage(at)
    place = np.clip(np.searchsorted(soc, at, side="right") - 1, 0, soc.size - 2)
    assert (found >= volts[place] - 1e-9).all()
    assert (found <= volts[place + 1] + 1e-9).all()
    assert (curve.slope(at) >= -1e-9).all()


@settings(max_examples=examples(100), deadline=None)
@given(points)
def test_the_inverse_is_one_for_every_curve(steps):
    soc, volts = rising(steps)
    curve = OcvCurve(soc, volts)
    asked = np.linspace(volts[0], volts[-1], 101)
    assert curve.voltage(curve.soc_at(asked)) == pytest.approx(asked, abs=0.02)


@settings(max_examples=examples(100))
@given(st.integers(3, 9), st.floats(-2.0, 2.0), st.floats(-5.0, 5.0))
@example(3, 2.2250738585e-313, 0.0)  # so flat that a division overflows
def test_slopes_of_a_line_are_its_own(n, slope, offset):
    x = np.cumsum(np.random.default_rng(n).uniform(0.05, 0.3, n))
    assert monotone_slopes(x, slope * x + offset) == pytest.approx(slope, abs=1e-9)


def test_the_slope_at_a_turn_is_none():
    """Where the data turn, a monotone curve has its extremum on the point."""
    assert monotone_slopes(np.arange(5.0), np.array([0.0, 1.0, 2.0, 1.0, 0.0]))[2] == 0.0


@pytest.mark.parametrize("method", OCV_METHODS)
def test_any_shape_is_answered_in_its_shape(method):
    curve = OcvCurve(SOC, VOLTS, method)
    at = np.linspace(-0.04, 1.04, 12).reshape(3, 2, 2)
    assert curve.voltage(at).shape == curve.slope(at).shape == curve.soc_at(curve.voltage(at)).shape == (3, 2, 2)
    for each in np.ndindex(at.shape):
        assert curve.voltage(at)[each] == curve.voltage(at[each])


def test_rests_in_any_order_make_the_same_curve():
    rng = np.random.default_rng(4)
    order = rng.permutation(SOC.size)
    np.testing.assert_array_equal(
        from_rests(SOC[order], VOLTS[order]).voltage(SOC), from_rests(SOC, VOLTS).voltage(SOC)
    )


def test_a_rest_that_lies_below_one_of_less_charge_does_not_bend_the_curve_down():
    curve = from_rests([0.1, 0.5, 0.6, 0.9], [3.4, 3.70, 3.69, 4.0])
    assert (np.diff(curve.voltage(np.linspace(0.1, 0.9, 200))) >= -1e-12).all()


def test_too_few_rests_are_refused():
    with pytest.raises(ModelError, match="at least two"):
        from_rests([0.5], [3.7])
    with pytest.raises(ModelError, match="at least two"):
        from_rests([0.5, 0.6], [3.7])


@pytest.mark.parametrize("volts", [VOLTS, PLATEAU], ids=["NMC", "LFP"])
def test_interpolation_is_the_monotone_cubic_of_scipy(volts):
    interpolate = pytest.importorskip("scipy.interpolate")
    curve, judge = OcvCurve(SOC, volts), interpolate.PchipInterpolator(SOC, volts)
    at = np.linspace(0.0, 1.0, 997)
    np.testing.assert_allclose(curve.voltage(at), judge(at), atol=1e-12)
    np.testing.assert_allclose(curve.slope(at), judge.derivative()(at), atol=1e-9)


@pytest.mark.parametrize("method", OCV_METHODS)
def test_cells_inside_outside_and_missing_are_each_as_alone(method):
    curve = OcvCurve(SOC * 0.8 + 0.1, VOLTS, method)
    together = np.array([[-0.04, 0.1, 0.5], [0.9, 1.04, np.nan]])
    for ask in (curve.voltage, curve.slope):
        found = ask(together)
        assert found.shape == together.shape
        alone = [float(ask(each)) for each in together.flat]
        np.testing.assert_array_equal(found.ravel(), alone)
    assert np.flatnonzero(np.isnan(curve.voltage(together))).tolist() == [5]


@pytest.mark.parametrize("method", OCV_METHODS)
def test_voltage_goes_on_without_a_step_where_the_measured_range_ends(method):
    curve = OcvCurve(SOC * 0.8 + 0.1, VOLTS, method)
    for end in curve.soc_range:
        inside, outside = curve.voltage([end - 1e-9, end + 1e-9])
        assert inside == pytest.approx(outside, abs=1e-7)
        assert curve.voltage(end) == pytest.approx(inside, abs=1e-7)
