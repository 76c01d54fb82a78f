"""Identified on some measured and simulated tests, judged on others: what a user gets on cells like his own.

Skipped where the shared data is absent. The bars are those of the product; the runs are parts of the drives so that the
tests stay quick, the whole drives are in `benchmarks/`.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.estimation.filters.estimators import make_estimator
from app.estimation.identification.identify import identify
from app.estimation.scoring import score_soc
from app.sources.recordings.dataset import load_recording
from tests.numeric.judgement import judge, part

DATA = Path(__file__).parents[3] / "shared" / "data"
PANASONIC, PHYSICS = DATA / "panasonic-18650pf", DATA / "physics"
pytestmark = pytest.mark.skipif(not DATA.exists(), reason="shared measured data not present")


def load(folder, name):
    return load_recording(folder / f"{name}.csv.gz")


def scores(model, recording, starts):
    """Return the score of each start SOC; all starts run as cells side by side. Sensor errors as in a car."""
    rng = np.random.default_rng(7)
    n, rows = len(starts), len(recording.time_s)
    voltage = np.round(recording.voltage_v + 1.2e-3 * rng.normal(size=rows), 4)
    c_rate = model.capacity_ah
    current = recording.current_a * 1.003 + 0.004 * c_rate + 0.02 * c_rate * rng.normal(size=rows)
    estimator = make_estimator("fused", model, n)
    one = np.ones(n)
    temperature = recording.temperature_degc
    estimator.start(voltage[0] * one, temperature[0] * one, current[0], np.array(starts))
    soc, sigma = np.empty((rows, n)), np.empty((rows, n))
    for k, dt_s in enumerate(recording.step_s.tolist()):
        estimates = estimator.step(dt_s, float(current[k]), voltage[k] * one, temperature[k] * one)
        soc[k], sigma[k] = estimates.soc, estimates.soc_sigma
    return [score_soc(recording.time_s, soc[:, j], sigma[:, j], recording.soc) for j in range(n)]


@pytest.fixture(scope="module")
def panasonic():
    return identify(
        [load(PANASONIC, "c20_ocv_25degC")],
        [load(PANASONIC, "hppc5pulse_25degC")],
        [load(PANASONIC, "cycle1_25degC")],
    )


@pytest.fixture(scope="module", params=["Mohtat2020", "Chen2020"])
def physics(request):
    """The cell fitted without the second half of its drive, and that half."""
    cell = request.param
    whole = load(PHYSICS, f"{cell}_train")
    found = identify(
        [load(PHYSICS, f"{cell}_c30")],
        [load(PHYSICS, f"{cell}_hppc"), load(PHYSICS, f"{cell}_hppc40")],
        [part(whole, 0, 900)],
    )
    return cell, found, whole


def test_capacity_of_the_measured_cell_is_not_the_slow_tests_count(panasonic):
    assert panasonic.counted_ah == pytest.approx(2.995, abs=0.01)
    assert panasonic.model.capacity_ah == pytest.approx(2.872, rel=0.003)
    assert any("slow test counts" in note for note in panasonic.notes)


def test_measured_cell_without_soc_columns_has_the_same_capacity(panasonic):
    bare = [
        replace(r, soc=np.full(len(r.soc), np.nan))
        for r in (load(PANASONIC, "hppc5pulse_25degC"), load(PANASONIC, "cycle1_25degC"))
    ]
    found = identify([load(PANASONIC, "c20_ocv_25degC")], bare[:1], bare[1:])
    assert found.model.capacity_ah == pytest.approx(2.872, rel=0.02)


def test_drive_of_the_measured_cell_from_right_and_wrong_start(panasonic):
    us06 = part(load(PANASONIC, "us06_25degC"), 0, 1200)
    right, wrong = scores(panasonic.model, us06, [1.0, 0.5])
    assert right.soc_rmse < 0.008
    assert wrong.settle_5_s <= 5.0
    assert wrong.settle_2_s <= 60.0
    assert wrong.soc_max_error_after_60s < 0.02
    assert right.inside_3_sigma >= 0.95


def test_a_start_two_points_off_recovers_and_sigma_says_how_far_it_is_off(panasonic):
    us06 = part(load(PANASONIC, "us06_25degC"), 0, 1200)
    (low,) = scores(panasonic.model, us06, [0.98])
    assert low.settle_2_s <= 5.0
    assert low.soc_rmse < 0.008
    assert low.inside_3_sigma >= 0.95


def test_unseen_half_of_a_race_from_the_right_start(physics):
    cell, found, whole = physics
    second = part(whole, 880, 1820)
    (right,) = scores(found.model, second, [second.soc[0]])
    # it begins in a pause of 70 s in which the hard-driven cell still relaxes: its voltage speaks against the SOC
    assert right.soc_rmse < {"Mohtat2020": 0.005, "Chen2020": 0.015}[cell]
    assert right.inside_3_sigma >= 0.95


def test_cold_start_in_the_middle_of_a_race(physics):
    cell, found, whole = physics
    if cell == "Chen2020":
        pytest.skip("no bar for a cell driven this hard")
    for start_s in (950, 1150):
        run = part(whole, start_s, start_s + 200)
        (score,) = scores(found.model, run, [run.soc[0] - 0.45])
        assert score.settle_5_s <= 60.0


def test_who_wakes_up_in_a_pause_of_a_drive_knows_how_little_its_voltage_says(physics):
    _, found, whole = physics
    for start_s, lasts_s in ((770, 300), (1700, 120)):
        (score,) = scores(found.model, part(whole, start_s, start_s + lasts_s), [np.nan])
        assert score.inside_3_sigma >= 0.99


def test_a_gross_start_under_load_costs_the_fusion_nothing(physics):
    _, found, whole = physics
    judged = judge(found.model, part(whole, 637, 1237), -0.45)
    assert judged.excess.max() < 0.2


@pytest.mark.parametrize("off", [0.0, -0.5])
def test_fusion_is_as_good_on_the_measured_cell(panasonic, off):
    judged = judge(panasonic.model, load(PANASONIC, "us06_25degC"), off)
    assert np.median(judged.excess) < 0.2
    assert judged.excess.max() < 0.3, "a capacity that may be wrong costs a little where it is right"
    assert judged.fused.max() < 0.75


@pytest.mark.parametrize("off", [0.0, -0.5])
def test_fusion_is_as_good_as_the_better_of_its_parts(physics, off):
    cell, found, whole = physics
    judged = judge(found.model, part(whole, 880, 1280), off)
    assert judged.excess.max() < {"Mohtat2020": 0.1, "Chen2020": 2.2}[cell], "a cell that has not come to rest"
    assert min(score.inside_3_sigma for score in judged.scores) >= 0.95
