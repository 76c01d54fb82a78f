"""What is remembered of the SOC, against time away and the master's count."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.cell_model.ocv import OcvCurve
from app.estimation.filters.estimators import Tuning, make_estimator
from app.live.estimator_start import start_estimator
from app.live.pipeline import Pipeline
from app.live.remembered_charge import (
    MASTER_SOC_SIGMA,
    REST_SIGMA,
    UNKNOWN_AWAY_S,
    MasterCount,
    RememberedCharge,
)
from app.sources.items import TableItem
from app.sources.table_source import TableSource
from tests.unit.app.live.test_any_battery import loaded

S = 1_000_000_000
CAPACITY_AH = np.full(3, 25.0)
SOC, SIGMA = np.array([0.7, 0.71, 0.69]), np.full(3, 0.012)
HOUR_S = 3600.0


def at(count, before, away_s=600.0):
    master = SimpleNamespace(charge_drawn_ah=count.drawn_ah, soc=count.soc)
    now = SimpleNamespace(t_wall_ns=round(away_s * S), uptime_ms=count.uptime_ms, master=master)
    return RememberedCharge(0, SOC, SIGMA, before).at(now, CAPACITY_AH, Tuning())


def test_a_count_that_ran_on_is_taken_from_what_was_remembered():
    soc, sigma = at(MasterCount(1_600_000, 7.5, 0.5), MasterCount(1_000_000, 2.5, 0.8))
    np.testing.assert_allclose(soc, SOC - 0.2)
    assert (sigma > SIGMA).all()
    assert (sigma < 1.1 * SIGMA).all()


def test_a_count_begun_anew_says_no_more_than_the_voltage_that_it_began_with():
    soc, sigma = at(MasterCount(5_000, 7.5, 0.5), MasterCount(1_000_000, 2.5, 0.8))
    np.testing.assert_array_equal(soc, SOC)
    np.testing.assert_allclose(sigma, np.hypot(SIGMA, REST_SIGMA), rtol=1e-3)


@pytest.mark.parametrize("uptime_ms", [900_000, 2_000_000], ids=["before", "another clock"])
def test_an_uptime_that_the_clock_contradicts_leaves_the_time_away_unknown(uptime_ms):
    soc, sigma = at(MasterCount(uptime_ms, 7.5, 0.5), MasterCount(1_000_000, 2.5, 0.8))
    _, after_a_month = at(MasterCount(5_000, 7.5, 0.5), MasterCount(1_000_000, 2.5, 0.8), UNKNOWN_AWAY_S)
    np.testing.assert_array_equal(soc, SOC)
    np.testing.assert_allclose(sigma, after_a_month)


def test_the_count_of_another_bms_that_says_the_same_confirms_and_one_far_off_is_followed():
    same, same_sigma = at(MasterCount(soc=0.8), MasterCount(soc=0.8))
    np.testing.assert_allclose(same, SOC)
    assert (same_sigma < 1.6 * SIGMA).all()
    far, far_sigma = at(MasterCount(soc=0.5), MasterCount(soc=0.8))
    np.testing.assert_allclose(far, SOC - 0.3, atol=1e-3)
    np.testing.assert_allclose(far_sigma, np.hypot(SIGMA, MASTER_SOC_SIGMA), rtol=0.05)


@pytest.mark.parametrize("moved", np.linspace(-0.3, 0.3, 25))
def test_whether_the_count_or_the_memory_is_right_both_lie_within_three_sigma(moved):
    soc, sigma = at(MasterCount(soc=0.5 + moved), MasterCount(soc=0.5))
    assert (np.abs(SOC + moved - soc) < 3 * sigma).all()
    if abs(moved) < 3 * MASTER_SOC_SIGMA:
        assert (np.abs(SOC - soc) < 3 * sigma).all()


def test_time_away_makes_less_sure_and_a_clock_that_ran_backwards_says_nothing_of_it():
    sigmas = [at(MasterCount(), MasterCount(), away_s)[1][0] for away_s in (0.0, 24 * HOUR_S, UNKNOWN_AWAY_S)]
    assert sigmas == sorted(set(sigmas))
    assert sigmas[2] > 0.03
    assert at(MasterCount(), MasterCount(), -24 * HOUR_S)[1][0] == sigmas[2]
    assert at(MasterCount(), MasterCount(), -1.0)[1][0] == sigmas[0], "set right by a second"


PLATEAU = np.interp(np.linspace(0.0, 1.0, 21), [0.0, 0.1, 0.35, 0.65, 1.0], [2.9, 3.2, 3.29, 3.295, 3.4])  # LFP
FLAT = replace(load_cell("samsung-25r-10p"), ocv=OcvCurve(np.linspace(0.0, 1.0, 21), PLATEAU))


def soc_after_a_silence(true_after, counted_after, silent_s=900.0):
    """Return what moved in a silence, and sigma before and after, of cells on a plateau at 0.6."""
    pipeline = Pipeline(
        TableSource(loaded((3,)).battery, "can"),
        lambda: make_estimator("fused", FLAT, 3),
        filter_name="fused",
        cell_name="flat",
        remembered=RememberedCharge(S, np.full(3, 0.6), SIGMA),
    )
    found = []
    for from_s, soc, counted in ((1.0, 0.6, 0.61), (121.0 + silent_s, true_after, counted_after)):
        volts = np.full(3, float(FLAT.ocv.voltage(np.array(soc))))
        for k in range(600):
            t_ns = round((from_s + k / 5) * S)
            estimates = pipeline.feed(TableItem(t_ns, t_ns, np.concatenate(([0.0, counted], volts)))).estimates
        found.append(estimates)
    before, after = found
    return after.soc - before.soc, before.soc_sigma, after.soc_sigma


def test_on_a_flat_ocv_the_count_decides_what_a_rest_cannot():
    moved, before, after = soc_after_a_silence(0.4, 0.41)
    np.testing.assert_allclose(moved, -0.2, atol=0.05)
    assert (after < before + 2 * MASTER_SOC_SIGMA).all()


def test_on_a_flat_ocv_nothing_changed_keeps_what_was_remembered():
    moved, before, after = soc_after_a_silence(0.6, 0.61)
    np.testing.assert_allclose(moved, 0.0, atol=0.005)
    assert (after < 1.1 * before).all()


@pytest.mark.parametrize("true_soc", [0.4, 0.45, 0.55, 0.6])
@pytest.mark.parametrize("away_s", [60.0, 8 * HOUR_S, -HOUR_S], ids=["a minute", "a night", "no clock"])
def test_a_flat_ocv_leaves_room_for_a_charge_that_nobody_counted(true_soc, away_s):
    estimator, volts = make_estimator("fused", FLAT, 3), FLAT.ocv.voltage(np.full(3, true_soc))
    master = SimpleNamespace(charge_drawn_ah=None, soc=None)
    now = SimpleNamespace(
        voltage_v=volts, temperature_degc=np.full(3, 25.0), master=master, uptime_ms=5_000, t_wall_ns=round(away_s * S)
    )
    start_estimator(estimator, now, 0.0, RememberedCharge(0, np.full(3, 0.6), SIGMA))
    for _ in range(600):
        found = estimator.step(0.2, 0.0, volts, now.temperature_degc)
        assert (np.abs(found.soc - true_soc) < 3 * found.soc_sigma).all()
    if true_soc == 0.6:
        np.testing.assert_allclose(found.soc, true_soc, atol=0.02)
