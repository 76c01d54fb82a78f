"""Identification of cells whose every number is known: what comes out must be what went in."""

from dataclasses import replace

import numpy as np
import pytest

from app.estimation.cell_model.circuit import CellModel
from app.estimation.cell_model.evidence import Evidence
from app.estimation.cell_model.ocv import OcvCurve
from app.estimation.errors import ModelError
from app.estimation.filters.estimators import make_estimator
from app.estimation.identification.identify import identify
from app.estimation.recording.cell_recording import clean
from tests.open_loop import simulate

SOC = np.linspace(0.0, 1.0, 51)
NMC_V = 3.0 + 1.2 * SOC - 0.35 * np.exp(-SOC / 0.04) + 0.05 * np.sin(6.0 * SOC)
FLAT_V = 3.28 + 0.04 * SOC - 0.6 * np.exp(-SOC / 0.03) + 0.12 * np.exp((SOC - 1.0) / 0.02)


def cell(capacity_ah=3.0, ocv_v=NMC_V, tau_s=(6.0, 90.0), activation_degc=(0.0, 25.0, 50.0), factors=(1.7, 1.0, 0.65)):
    ohm = 0.06 / capacity_ah
    soc_grid = np.array([0.0, 0.1, 0.3, 1.0])
    over_soc = np.array([2.0, 1.3, 1.0, 1.0])
    r0 = ohm * np.outer(factors, over_soc)
    r = np.array([0.4 * r0, 0.6 * r0])[: len(tau_s)]
    return CellModel(
        name="known",
        capacity_ah=capacity_ah,
        ocv=OcvCurve(SOC, ocv_v),
        soc_grid=soc_grid,
        temperature_grid_degc=np.array(activation_degc),
        r0_ohm=r0,
        r_ohm=r,
        tau_s=np.broadcast_to(np.array(tau_s)[:, None, None], r.shape),
        v_min_v=2.0,
        v_max_v=4.4,
    )


def record(model, name, steps, soc_start, step_s=1.0, degc=25.0, noise_v=0.0, with_soc=True, count_scale=1.0):
    """Return the recording of (current in C, seconds) steps."""
    current = np.concatenate([np.full(max(round(s / step_s), 1), c * model.capacity_ah) for c, s in steps])
    time_s = step_s * np.arange(current.size)
    temperature = np.full(current.size, degc)
    soc, voltage = simulate(model, time_s, current, temperature, soc_start, trapezoidal=True)
    voltage += noise_v * np.random.default_rng(1).normal(size=voltage.size)
    columns = {
        "time_s": time_s,
        "current_a": count_scale * current,
        "voltage_v": voltage,
        "temperature_degc": temperature,
    }
    return clean(name, {**columns, "soc": soc} if with_soc else columns)


def slow(model, **more):
    rate, hours = 1 / 30, 29.9
    steps = [(0, 600), (rate, 3600 * hours), (0, 3600), (-rate, 3600 * hours), (0, 3600)]
    return record(model, "slow", steps, 0.9985, step_s=60.0, **more)


def pulses(model, soc_levels=9, **more):
    steps = [(0, 60)]
    for _ in range(soc_levels):
        steps += [(3, 10), (0, 60), (-1.5, 10), (0, 60), (1, 330), (0, 1800)]
    return record(model, "pulses", steps, 1.0, **more)


def drive(model, seed=1, seconds=1500, peak_c=6.0, step_s=0.5, soc_start=0.95, **more):
    rng = np.random.default_rng(seed)
    steps = [(0, 20)]
    while sum(s for _, s in steps) < seconds:
        steps += [
            (peak_c * rng.uniform(0.1, 1.0), rng.uniform(1, 6)),
            (-1.5 * rng.random(), 3),
            (0.2, rng.uniform(1, 8)),
        ]
    return record(model, "drive", steps, soc_start, step_s=step_s, **more)


@pytest.fixture(scope="module")
def found():
    model = cell()
    return identify(
        [slow(model, noise_v=3e-4)],
        [pulses(model, noise_v=3e-4), pulses(model, degc=40.0, noise_v=3e-4)],
        [drive(model, noise_v=3e-4)],
        n_rc=2,
    )


@pytest.mark.parametrize("seconds", [0.0, 10.0, 60.0, 300.0])
def test_known_drops_come_back(found, seconds):
    """Other equations, the same drop: of 3C after any time, at any SOC."""
    truth, soc = cell(), np.array([0.3, 0.5, 0.8])
    drops = []
    for model in (truth, found.model):
        branch_a = 9.0 * (1.0 - np.exp(-seconds / model.time_constants(soc, 25.0)))
        drops.append(model.drop_v(soc, branch_a, 9.0, 25.0))
    np.testing.assert_allclose(drops[1], drops[0], rtol=0.12)
    assert found.model.capacity_ah == pytest.approx(3.0, rel=0.003)


def test_open_circuit_voltage_comes_back(found):
    inside = np.linspace(0.05, 0.97, 50)
    np.testing.assert_allclose(found.model.ocv.voltage(inside), cell().ocv.voltage(inside), atol=0.004)


def test_a_drive_that_was_not_fitted_is_followed(found):
    truth = cell()
    other = drive(truth, seed=9, peak_c=6.0, degc=32.0)
    _, voltage = simulate(found.model, other.time_s, other.current_a, other.temperature_degc, 0.95, trapezoidal=True)
    assert np.sqrt(np.mean((voltage - other.voltage_v) ** 2)) < 0.008


def test_every_part_is_reported_and_nothing_is_warned_of(found):
    assert [part.name for part in found.parts] == ["pulses", "pulses", "drive"]
    assert all(part.voltage_rms_v < 0.004 for part in found.parts)
    assert found.warnings == ()


@pytest.mark.parametrize("capacity_ah", [0.01, 100.0])
def test_capacity_of_any_size_fits_alike(capacity_ah):
    model = cell(capacity_ah=capacity_ah)
    result = identify([slow(model)], [pulses(model)], [drive(model)])
    assert result.model.capacity_ah == pytest.approx(capacity_ah, rel=0.003)
    assert result.parts[1].voltage_rms_v < 0.003


def test_flat_open_circuit_voltage_fits():
    model = cell(ocv_v=FLAT_V)
    result = identify([slow(model)], [pulses(model)], [drive(model)])
    assert all(part.voltage_rms_v < 0.005 for part in result.parts)


@pytest.mark.parametrize("step_s", [0.05, 10.0])
def test_sampling_fast_or_slow_fits(step_s):
    model = cell(tau_s=(40.0, 400.0))
    result = identify([slow(model)], [pulses(model, soc_levels=6)], [drive(model, step_s=step_s, seconds=900)])
    assert all(part.voltage_rms_v < 0.006 for part in result.parts)


@pytest.mark.parametrize("n_rc", [0, 1, 3, 4])
def test_any_number_of_pairs_fits(n_rc):
    model = cell()
    result = identify([slow(model)], [pulses(model, soc_levels=5)], [drive(model, seconds=600)], n_rc=n_rc)
    assert result.model.n_rc == len(result.tau_s) == n_rc
    assert np.isfinite(result.model.fit_voltage_rms_v)


def test_a_circuit_of_the_theses_has_no_surface_and_its_pairs_come_back():
    model = cell()
    result = identify([slow(model)], [pulses(model)], [drive(model)], is_circuit=True)
    assert result.model.surface_per_a.max() < 1e-6
    assert result.parts[1].voltage_rms_v < 0.005


def test_recordings_without_soc_are_laid_on_the_curve_by_their_rests():
    model = cell()
    result = identify(
        [slow(model, with_soc=False)], [pulses(model, with_soc=False)], [drive(model, with_soc=False)], n_rc=2
    )
    assert result.model.capacity_ah == pytest.approx(3.0, rel=0.02)
    assert result.parts[1].soc_range[1] == pytest.approx(0.95, abs=0.01)
    assert result.parts[1].voltage_rms_v < 0.008


def test_charge_counter_of_the_slow_test_is_not_trusted_against_all_others():
    model = cell()
    result = identify([slow(model, with_soc=False, count_scale=1.04)], [pulses(model)], [drive(model)])
    assert result.counted_ah == pytest.approx(3.12, rel=0.01)
    assert result.model.capacity_ah == pytest.approx(3.0, rel=0.003)
    assert any("slow test counts" in note for note in result.notes)


def test_discharge_alone_gives_a_curve_above_it():
    model = cell()
    only = record(model, "slow", [(0, 600), (1 / 20, 3600 * 19.9)], 0.9985, step_s=60.0)
    result = identify([only], [pulses(model)], [drive(model)])
    inside = np.linspace(0.1, 0.95, 20)
    np.testing.assert_allclose(result.model.ocv.voltage(inside), model.ocv.voltage(inside), atol=0.008)


def test_pulses_without_a_drive_are_warned_of():
    model = cell()
    result = identify([slow(model)], [pulses(model)])
    assert any("--drive" in warning for warning in result.warnings)


def test_wrong_sign_is_named():
    model = cell()
    turned = pulses(model)
    turned = clean(
        "p", {n: (-1 if n == "current_a" else 1) * getattr(turned, n) for n in ("time_s", "current_a", "voltage_v")}
    )
    with pytest.raises(ModelError):
        identify([slow(model)], [turned])


def test_a_slow_charge_alone_is_enough():
    model = cell()
    charge = record(model, "charge", [(-1 / 20, 3600 * 19.9)], 0.0, step_s=60.0)
    result = identify([charge], [pulses(model)], [drive(model)])
    inside = np.linspace(0.1, 0.95, 20)
    np.testing.assert_allclose(result.model.ocv.voltage(inside), model.ocv.voltage(inside), atol=0.008)


def test_counts_that_cannot_be_of_the_slow_tests_cell_are_refused_by_name():
    model = cell()
    milliamperes = pulses(model, with_soc=False)
    milliamperes.current_a[:] *= 1000.0
    with pytest.raises(ModelError, match=r"pulses: counts .* Ah between rests"):
        identify([slow(model, with_soc=False)], [milliamperes])


def test_a_flat_cell_is_warned_of():
    model = cell(ocv_v=FLAT_V)
    warnings = identify([slow(model)], [pulses(model)], [drive(model)]).warnings
    assert any("rests on counted charge" in warning for warning in warnings)


def test_every_part_that_misses_the_voltage_is_warned_of():
    model, other = cell(), cell(factors=(4.0, 4.0, 4.0))
    result = identify([slow(model)], [pulses(other)], [drive(model, with_soc=False)])
    missed = {part.name for part in result.parts if part.voltage_rms_v > 0.03}
    assert missed
    assert missed == {w.split(":")[0] for w in result.warnings if "misses the voltage" in w}


def test_a_fast_discharge_is_raised_to_the_rests_of_the_pulse_tests():
    model = cell()
    fast = record(model, "fast", [(0, 60), (1, 3400), (0, 60)], 1.0)
    result = identify([fast], [pulses(model)], [drive(model)])
    assert result.model.evidence.has_ocv
    assert any("raised to" in note for note in result.notes)
    inside = np.linspace(0.15, 0.9, 20)
    np.testing.assert_allclose(result.model.ocv.voltage(inside), model.ocv.voltage(inside), atol=0.015)


def test_tests_that_measured_no_ocv_are_refused():
    model = cell()
    fast = record(model, "fast", [(0, 60), (1, 3400), (0, 60)], 1.0, with_soc=False)
    with pytest.raises(ModelError, match="fast: nothing measured the OCV"):
        identify([fast], [], [drive(model)])


def test_no_filter_calls_a_model_valid_whose_cell_file_has_no_ocv():
    model = replace(cell(), evidence=Evidence(has_ocv=False))
    estimator = make_estimator("fused", model, 1)
    estimator.start([3.7], [25.0], 0.0)
    assert not estimator.step(1.0, 0.0, [3.7], [25.0]).model_valid.any()


def test_on_a_flat_curve_with_hysteresis_the_counted_charge_holds():
    """Rests that hysteresis has raised would, read on the curve, say that less charge was drawn."""
    model = cell(ocv_v=FLAT_V)
    test = pulses(model, with_soc=False)
    idle = test.current_a == 0.0
    test.voltage_v[:] += np.where(idle & (test.time_s > 0.6 * test.time_s[-1]), 0.03, 0.0)
    counted_ah = float(np.ptp(test.seen_charge_ah))
    assert identify([test], [test], n_rc=1).model.capacity_ah == pytest.approx(counted_ah, rel=0.02)


def test_a_cold_drive_that_ends_low_is_fitted_and_no_offset_runs_away():
    model = cell(factors=(3.0, 1.0, 0.65))
    tests = [pulses(model, degc=degc) for degc in (25.0, 0.0)]
    result = identify([slow(model)], tests, [drive(model, degc=0.0, seconds=2600, peak_c=5.0, soc_start=1.0)])
    assert np.abs(result.model.ocv_shift_v).max() < 0.1
    inside = np.linspace(0.1, 0.95, 20)
    np.testing.assert_allclose(result.model.ocv.voltage(inside), model.ocv.voltage(inside), atol=0.01)
