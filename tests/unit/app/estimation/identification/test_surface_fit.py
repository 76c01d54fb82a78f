"""The fit of the few numbers: its slopes are those of its voltages, and what no recording shows stays as it was."""

import numpy as np
import pytest

from app.estimation.identification.identify import lowest_soc, next_test, open_loop_voltage, seen_temperatures
from app.estimation.identification.parts import Part
from app.estimation.identification.slow_tests import SlowCurves
from app.estimation.identification.surface_fit import (
    LAG_S,
    OcvBasis,
    Rows,
    Unknowns,
    fit_surface,
    voltage_and_slopes,
)
from app.estimation.recording.cell_recording import Recording

GRID = np.linspace(0.0, 1.0, 401)
RESTED_V = 3.0 + GRID - 0.4 * np.exp(-GRID / 0.05)
SLOW = SlowCurves(GRID, RESTED_V - 0.01, RESTED_V + 0.01, 3.0, 0.1, True)


def recording(degc=25.0, seconds=1500, soc_start=0.9, peak_a=9.0):
    rng = np.random.default_rng(3)
    current = np.repeat(rng.uniform(-0.3, 1.0, seconds // 10) * peak_a, 10)
    time_s = np.arange(seconds) * 1.0
    soc = soc_start - np.concatenate(([0.0], np.cumsum(0.5 * (current[1:] + current[:-1])))) / 3600.0 / 3.0
    voltage = np.interp(soc, GRID, RESTED_V) - 0.03 * current
    return Recording("drive", time_s, current, voltage, np.full(seconds, degc), soc, ())


def part(**how):
    made = recording(**how)
    return Part(made, made.soc, is_drive=True)


@pytest.mark.parametrize("n_lags", range(len(LAG_S)))
def test_slopes_are_those_of_the_voltages(n_lags):
    rng = np.random.default_rng(n_lags)
    unknowns, basis = Unknowns(SLOW, 0.09, n_lags), OcvBasis(SLOW)
    rows = Rows(part(degc=8.0), SLOW, 3.0)
    x = unknowns.bounded(unknowns.mean + 0.5 * unknowns.sigma * rng.normal(size=unknowns.mean.size))
    _, slopes = voltage_and_slopes(unknowns, basis, rows, x)
    for name, place in unknowns.places.items():
        for k in range(place.start, place.stop):
            step = 1e-4 * unknowns.sigma[k] * (np.arange(x.size) == k)
            high, low = (voltage_and_slopes(unknowns, basis, rows, x + s)[0] for s in (step, -step))
            found = (high - low) / (2e-4 * unknowns.sigma[k])
            # the curve bends at the points of its grid
            off = np.abs(found - slopes[:, k]) * unknowns.sigma[k]
            assert np.quantile(off, 0.98) < 2e-4 * (1.0 + np.abs(slopes[:, k] * unknowns.sigma[k]).max()), name


def test_the_fit_and_the_cell_model_have_one_voltage():
    from app.estimation.identification.identify import _cell_model

    parts = [part(), part(degc=5.0)]
    fit = fit_surface(parts, SLOW, 3.0, 0.03, 2)
    model = _cell_model(fit, SLOW, [each.recording for each in parts], 3.0, "test", "test")
    for each in parts:
        left_v = each.recording.voltage_v - open_loop_voltage(model, each)
        assert np.sqrt(np.mean(left_v[each.soc > 0.05] ** 2)) < 0.012


def test_what_no_recording_shows_stays_as_it_usually_is():
    fit = fit_surface([part()], SLOW, 3.0, 0.03, 2)
    assert fit.learned["kinetics_energy"] == pytest.approx(1.0, abs=0.02)
    assert fit.learned["ohmic"] < 0.7
    both = fit_surface([part(), part(degc=0.0)], SLOW, 3.0, 0.03, 2)
    assert both.learned["ohmic_energy"] < 0.9


def test_the_test_that_helps_most_is_named():
    known = dict.fromkeys(("kinetics_energy", "diffusion_energy", "i0", "d1"), 0.2)
    assert next_test(known, has_slow_charge=True) is None
    assert "slow charge" in next_test(known, has_slow_charge=False)
    assert "another temperature" in next_test({**known, "kinetics_energy": 1.0}, has_slow_charge=True)


def test_seen_are_the_temperatures_of_the_recordings_alone():
    cold, warm = recording(degc=-8.0), recording(degc=25.0)
    warm.temperature_degc[:] = np.linspace(20.0, 38.0, warm.temperature_degc.size)
    seen = seen_temperatures([cold, warm])
    assert seen[0] == -8.0
    assert seen[-1] == pytest.approx(38.0, abs=0.3)
    assert not ((seen > -6.0) & (seen < 19.0)).any()
    assert np.diff(seen[seen > 15.0]).max() <= 5.0


def test_the_lowest_soc_is_that_of_the_recordings_there_or_colder():
    cold, mild, warm = part(degc=-8.0, soc_start=0.9), part(degc=5.0, soc_start=0.95), part(degc=25.0, soc_start=0.8)
    found = lowest_soc([warm, cold, mild], 3.0)
    assert [degc for degc, _ in found] == [-8.0, 25.0], "what the cold has shown holds where it is milder"
    assert found[0][1] == pytest.approx(cold.soc.min(), abs=0.01)
    assert found[1][1] == pytest.approx(warm.soc.min(), abs=0.01)
