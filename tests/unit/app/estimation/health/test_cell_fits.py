"""Each law is found in the voltage that it makes, with its size; a sound cell has none."""

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.health.cell_finding import BAND_SIGMAS
from app.estimation.health.cell_fits import HEALTHY_OHM, fit_cell
from app.estimation.health.cell_voltages import CellVoltage, slow_current

MODEL = load_cell("samsung-25r-10p")
TIME_S = np.arange(0.0, 300.0, 1.0)
CURRENT_A = np.where((TIME_S // 12) % 3 == 2, -20.0, 80.0) * (TIME_S < 280)
USED = np.cumsum(CURRENT_A) / 3600 / MODEL.capacity_ah


def cell(deviation_v):
    rng = np.random.default_rng(1)
    soc = 0.7 - USED
    middle = MODEL.ocv.voltage(soc) - 2.4e-3 * CURRENT_A
    noise = np.full(TIME_S.size, 2e-3)
    voltage = middle + deviation_v + 5e-4 * rng.standard_normal(TIME_S.size)
    branches = np.array([slow_current(TIME_S, CURRENT_A, float(tau_s.mean())) for tau_s in MODEL.tau_s])
    return CellVoltage(TIME_S, CURRENT_A, USED, soc, branches, voltage, middle, noise, float(TIME_S[-1]))


def fits(deviation_v):
    return {fit.law: fit for fit in fit_cell(cell(deviation_v), MODEL, lambda size, onset_s: 0.0)}


def test_a_joint_that_grows_is_found_with_its_size_and_beginning():
    found = fits(np.where(TIME_S > 150.0, -2e-3 * CURRENT_A, 0.0))
    best = max(found.values(), key=lambda fit: fit.log_likelihood)
    assert best.law == "joint"
    assert best.size == pytest.approx(2e-3, rel=0.15)
    assert best.onset_s == pytest.approx(150.0, abs=25.0)


def test_a_current_sensor_s_zero_makes_a_large_joint_no_less_likely():
    """It trips the car within seconds: after that most samples are of a small current, which the zero makes up."""
    one = cell(np.where(TIME_S >= 276.0, -16e-3 * CURRENT_A, 0.0))

    def joint(zero_a):
        parts = _parts(one) | {"current_a": CURRENT_A + zero_a, "noise_v": np.full(TIME_S.size, 5e-4)}
        return {fit.law: fit for fit in fit_cell(CellVoltage(**parts), MODEL, lambda size, onset_s: 0.0)}["joint"]

    known, shifted = joint(0.0), joint(0.4)
    assert shifted.log_likelihood > known.log_likelihood - 2.0
    assert shifted.size == pytest.approx(16e-3, rel=0.03)


@pytest.mark.parametrize("ohm", [1e-3, 5e-3, 14e-3])
def test_the_band_of_a_joint_holds_its_size_and_is_not_wide(ohm):
    found = fits(np.where(TIME_S > 150.0, -ohm * CURRENT_A, 0.0))["joint"]
    assert abs(found.size - ohm) <= BAND_SIGMAS * found.sigma
    assert 0.0 < found.sigma < 0.15 * ohm


def test_every_size_that_is_fitted_has_a_sigma_and_a_stuck_input_none():
    soc = 0.7 - USED
    found = fits(MODEL.ocv.voltage(soc - 0.6 * USED) - MODEL.ocv.voltage(soc))
    assert found["capacity"].sigma < 0.3 * found["capacity"].size
    assert all(fit.sigma > 0.0 for law, fit in found.items() if law not in ("warm", "stuck"))


def polarisation_v(times):
    """Of the cell's RC pairs; with the same capacitance from 250 s on, a cell that resists more is slower."""
    total = np.zeros(TIME_S.size)
    for ohm, tau_s in zip(MODEL.r_ohm.mean(axis=(1, 2)), MODEL.tau_s.mean(axis=(1, 2)), strict=True):
        held = 0.0
        for k, amps in enumerate(CURRENT_A):
            factor = times if TIME_S[k] >= 250.0 else 1.0
            held += -np.expm1(-1.0 / (factor * tau_s)) * (factor * ohm * amps - held)
            total[k] += held
    return total


@pytest.mark.parametrize("times", [1.6, 2.5, 5.0])
def test_inner_resistance_is_told_from_a_joint_by_what_comes_slowly(times):
    """Soon after it has grown too, as before a trip."""
    r0_ohm = MODEL.r0_ohm.mean()
    grown = (times - 1.0) * r0_ohm * CURRENT_A * (TIME_S >= 250.0) + polarisation_v(times) - polarisation_v(1.0)
    found = fits(-grown)
    assert found["resistance"].log_likelihood > found["joint"].log_likelihood + 2.0
    assert found["resistance"].size == pytest.approx((times - 1.0) * r0_ohm, rel=0.15)
    joint = fits(-(times - 1.0) * r0_ohm * CURRENT_A * (TIME_S >= 250.0))
    assert joint["joint"].log_likelihood > joint["resistance"].log_likelihood + 2.0


def test_lost_capacity_follows_the_charge_used():
    soc = 0.7 - USED
    found = fits(MODEL.ocv.voltage(soc - 0.6 * USED) - MODEL.ocv.voltage(soc))
    best = max(found.values(), key=lambda fit: fit.log_likelihood)
    assert best.law == "capacity"
    assert best.size == pytest.approx(0.6, rel=0.3)


def under_load(soc):
    """The model's voltage at a charge, with the resistances of that charge."""
    parts = MODEL.parameters(soc, 25.0)
    drops = parts[0] * CURRENT_A
    for k, tau_s in enumerate(MODEL.tau_s):
        drops += parts[2 + k] * slow_current(TIME_S, CURRENT_A, float(tau_s.mean()))
    return MODEL.ocv.voltage(soc) - drops


@pytest.mark.parametrize("more", [0.45, 1.0, 1.75, 1.9])
def test_a_cell_that_empties_resists_more_and_has_lost_capacity_all_the_same(more):
    """Near empty its resistance doubles; between the steps of the searched sizes it is found as well."""
    soc = 0.7 - USED
    found = fits(under_load(soc - more * USED) - under_load(soc))
    best = max(found.values(), key=lambda fit: fit.log_likelihood)
    assert best.law == "capacity"
    assert best.size == pytest.approx(more, rel=0.03)


def test_an_input_that_stands_still_is_found():
    one = cell(0.0)
    voltage = np.where(TIME_S > 200.0, 3.3, one.voltage_v)
    found = fit_cell(CellVoltage(**{**_parts(one), "voltage_v": voltage}), MODEL, lambda size, onset_s: 0.0)
    best = max(found, key=lambda fit: fit.log_likelihood)
    assert (best.law, best.size) == ("stuck", pytest.approx(3.3))


def test_a_sound_cell_gains_nothing_from_any_law():
    for deviation_v in (0.0, -0.5 * HEALTHY_OHM * CURRENT_A, 0.5 * HEALTHY_OHM * CURRENT_A):
        assert max(fit.log_likelihood for fit in fits(deviation_v).values()) < 2.0


def _parts(one):
    return {name: getattr(one, name) for name in CellVoltage.__dataclass_fields__}
