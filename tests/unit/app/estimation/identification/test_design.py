"""The columns of the fit: interpolation, heat, memory, and how much each row counts."""

import numpy as np
import pytest

from app.estimation.identification.design import (
    DEFAULT_ACTIVATION_J_MOL,
    OFFSET_SOC,
    OVERPOTENTIAL_SOC,
    RESISTANCE_SOC,
    Design,
    arrhenius,
    branch_current,
    hat_weights,
    temperature_weights,
)
from app.estimation.identification.parts import Part
from app.estimation.identification.slow_tests import SlowCurves
from app.estimation.recording.cell_recording import Recording

CAPACITY_AH = 3.0
GRID = np.linspace(0.0, 1.0, 101)
SLOW = SlowCurves(GRID, 3.0 + GRID, 3.04 + GRID, CAPACITY_AH, 0.1, True)
KNOTS_DEGC = np.array([25.0])
KNOWN_OHM, KNOWN_RC_OHM, TAU_S = 0.02, 0.01, 12.0


def part(degc=25.0, missing=()):
    """A drive of a cell with one resistance, one RC pair, and the OCV midway between the slow branches."""
    rng = np.random.default_rng(6)
    current = np.concatenate((np.zeros(20), np.repeat(rng.uniform(-3.0, 12.0, 60), 10), np.zeros(400)))
    time_s = 1.0 * np.arange(current.size)
    moved = np.concatenate(([0.0], np.cumsum(0.5 * (current[1:] + current[:-1])))) / 3600 / CAPACITY_AH
    soc = 0.9 - moved
    factor = float(arrhenius(np.array(degc), DEFAULT_ACTIVATION_J_MOL))
    drop = factor * (KNOWN_OHM * current + KNOWN_RC_OHM * branch_current(time_s, current, TAU_S))
    volts = 3.02 + soc - drop
    volts[list(missing)] = np.nan
    return Part(Recording("drive", time_s, current, volts, np.full(current.size, degc), soc, ()), soc, True)


def coefficients():
    return np.concatenate(
        (
            np.full(RESISTANCE_SOC.size, KNOWN_OHM),
            np.full(RESISTANCE_SOC.size, KNOWN_RC_OHM),
            np.zeros(OVERPOTENTIAL_SOC.size),
            [0.5, 0.5],
            np.zeros(OFFSET_SOC.size),
        )
    )


@pytest.mark.parametrize("degc", [5.0, 25.0, 45.0])
def test_the_columns_of_a_known_cell_give_its_voltage(degc):
    design = Design(part(degc), SLOW, CAPACITY_AH, KNOTS_DEGC)
    predicted = design.columns((TAU_S,)) @ coefficients()
    np.testing.assert_allclose(predicted, design.target, atol=1e-9)


def test_the_normal_equations_are_solved_by_the_known_cell():
    design = Design(part(), SLOW, CAPACITY_AH, KNOTS_DEGC)
    columns = design.columns((TAU_S,))
    gram, moment = design.normal_equations(columns)
    np.testing.assert_allclose(gram @ coefficients(), moment, rtol=1e-6, atol=1e-6 * np.abs(moment).max())
    np.testing.assert_allclose(gram, gram.T, rtol=1e-9, atol=1e-9 * np.abs(gram).max())
    half = design.normal_equations(columns, np.full(design.target.size, 0.5))
    np.testing.assert_allclose(half[0], 0.5 * gram, rtol=1e-9, atol=1e-9 * np.abs(gram).max())


def test_a_part_adds_its_equations_at_the_places_of_its_temperature():
    knots = np.array([0.0, 25.0])
    design = Design(part(), SLOW, CAPACITY_AH, knots)
    columns = design.columns((TAU_S,))
    n = 2 * (2 * RESISTANCE_SOC.size + OVERPOTENTIAL_SOC.size + OFFSET_SOC.size) + 2
    gram, moment = np.zeros((n, n)), np.zeros(n)
    design.add_equations(gram, moment, (TAU_S,), columns)
    cold, warm = slice(0, RESISTANCE_SOC.size), slice(RESISTANCE_SOC.size, 2 * RESISTANCE_SOC.size)
    assert not gram[cold].any()
    assert gram[warm, warm].any()
    own, _ = design.normal_equations(columns)
    np.testing.assert_allclose(gram[warm, warm], own[: RESISTANCE_SOC.size, : RESISTANCE_SOC.size])


def test_between_two_temperatures_weights_are_linear_in_the_inverse():
    weights = temperature_weights(np.array([0.0, 30.0]), np.array([-20.0, 0.0, 15.0, 30.0, 50.0]))
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    np.testing.assert_allclose(weights[[0, 1, 3, 4], 1], [0.0, 0.0, 1.0, 1.0])
    expected = (1 / 273.15 - 1 / 288.15) / (1 / 273.15 - 1 / 303.15)
    assert weights[2, 1] == pytest.approx(expected)


def test_missing_voltages_and_unplaced_rows_do_not_count():
    whole, holed = (
        Design(part(), SLOW, CAPACITY_AH, KNOTS_DEGC),
        Design(part(missing=range(100, 200)), SLOW, CAPACITY_AH, KNOTS_DEGC),
    )
    assert whole.target.size - holed.target.size == 100
    assert np.isfinite(holed.target).all()


def test_a_long_rest_counts_less_than_driving():
    design = Design(part(), SLOW, CAPACITY_AH, KNOTS_DEGC)
    assert design.weight.sum() == pytest.approx(1.0)
    assert design.weight[-1] < 0.2 * design.weight[300]


def test_hats_interpolate_and_hold_at_the_ends():
    knots = np.array([0.0, 0.2, 1.0])
    x = np.array([-1.0, 0.0, 0.1, 0.6, 1.0, 3.0])
    weights = hat_weights(knots, x)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    values = np.array([5.0, 1.0, 3.0])
    np.testing.assert_allclose(weights @ values, np.interp(x, knots, values))


def test_cold_resists_more_and_25_degc_is_the_reference():
    factors = arrhenius(np.array([0.0, 25.0, 50.0]), 20e3)
    assert factors[0] > factors[1] == 1.0 > factors[2]
    np.testing.assert_array_equal(arrhenius(np.array([0.0, 50.0]), 0.0), 1.0)


def test_an_rc_current_follows_with_its_time_constant():
    time_s = 0.5 * np.arange(200)
    current = np.where(time_s > 0.0, 6.0, 6.0)
    found = branch_current(time_s, current, 10.0)
    np.testing.assert_allclose(found[-1], 6.0 * (1.0 - np.exp(-time_s[-1] / 10.0)), rtol=1e-9)
