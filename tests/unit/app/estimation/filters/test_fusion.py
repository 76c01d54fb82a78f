import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.fusion import Fusion, count_variance
from app.estimation.filters.inputs import InputGuard
from app.estimation.filters.process import Process
from app.estimation.filters.start import start_count
from app.estimation.filters.states import SOC, CellStates
from app.estimation.filters.tables import PackedCell
from app.estimation.filters.tuning import Tuning

TUNING = Tuning(anchor_s=60.0)


def states(filter_soc: float, count_soc: float, count_sigma: float = 0.01) -> CellStates:
    state = CellStates(2, 1)
    state.mean[SOC] = filter_soc
    start_count(state, np.array([count_soc]), np.array([count_sigma]))
    return state


def test_witnesses_as_sure_as_each_other_meet_halfway_and_are_no_surer_together():
    soc, variance = Fusion(states(0.51, 0.50), TUNING).fuse(0.1, np.array([0.51]), np.array([1e-4]))
    assert soc[0] == pytest.approx(0.505, abs=5e-4)
    assert variance[0] == pytest.approx(1e-4, rel=0.05)


@pytest.mark.parametrize(("filter_sigma", "count_sigma", "nearer"), [(0.02, 0.01, 0.50), (0.01, 0.02, 0.51)])
def test_of_witnesses_that_agree_the_surer_one_counts(filter_sigma, count_sigma, nearer):
    soc, variance = Fusion(states(0.51, 0.50, count_sigma), TUNING).fuse(
        0.1, np.array([0.51]), np.array([filter_sigma**2])
    )
    by_precision = (0.51 * count_sigma**2 + 0.50 * filter_sigma**2) / (count_sigma**2 + filter_sigma**2)
    assert abs(soc[0] - nearer) < 0.5 * abs(by_precision - nearer)
    assert np.sqrt(variance[0]) == pytest.approx(0.01, rel=0.1)


def test_a_filter_that_wanders_against_the_count_is_taken_for_less_sure_and_one_that_is_only_apart_is_not():
    wandering, apart = states(0.52, 0.50), states(0.52, 0.50)
    swing, still = Fusion(wandering, TUNING), Fusion(apart, TUNING)
    for k in range(1200):
        swung = swing.fuse(1.0, np.array([0.52 + 0.03 * np.sin(2 * np.pi * k / 200.0)]), np.array([1e-4]))
        stood = still.fuse(1.0, np.array([0.52]), np.array([1e-4]))
    assert 0.03 / np.sqrt(2.0) < np.sqrt(wandering.wander_v2[0]) < 2.0 * 0.03
    assert abs(swung[0][0] - 0.50) < 0.005
    assert np.sqrt(apart.wander_v2[0]) < 1e-3
    assert stood[0][0] > 0.505


def test_what_a_filter_learns_in_a_long_gap_is_not_its_wander():
    state = states(0.52, 0.50)
    fusion = Fusion(state, TUNING)
    fusion.fuse(20.0 * 3600.0, np.array([0.70]), np.array([1e-2]))
    assert np.sqrt(state.wander_v2[0]) < 1e-3
    assert state.apart[0] == pytest.approx(0.20)


def test_a_count_that_is_contradicted_does_not_count():
    soc, variance = Fusion(states(0.90, 0.40), TUNING).fuse(0.1, np.array([0.90]), np.array([4e-4]))
    assert soc[0] == pytest.approx(0.90, abs=1e-4)
    assert variance[0] == pytest.approx(4e-4, rel=0.01)


@pytest.mark.parametrize("filter_sigma", [0.10, 0.15])
def test_a_start_half_of_the_range_off_is_not_believed_by_a_filter_that_knows_little_either(filter_sigma):
    soc, _ = Fusion(states(0.60, 0.15, 0.007), TUNING).fuse(0.1, np.array([0.60]), np.array([filter_sigma**2]))
    assert soc[0] == pytest.approx(0.60, abs=0.001)


def test_between_agreement_and_contradiction_sigma_covers_both():
    state = states(0.60, 0.50, 0.01)
    for gap in np.linspace(0.0, 0.2, 81):
        state.count_soc[0] = 0.6 - gap
        soc, variance = Fusion(state, TUNING).fuse(0.0, state.mean[SOC], np.array([4e-4]))
        assert variance[0] > 0.0
        assert 0.6 - gap - 1e-12 <= soc[0] <= 0.6 + 1e-12


def test_a_count_contradicted_without_a_break_is_anchored_anew():
    state = states(0.90, 0.40)
    for _ in range(61):
        Fusion(state, TUNING).fuse(1.0, state.mean[SOC], np.array([4e-4]))
    assert state.count_soc[0] == 0.90
    assert count_variance(state.drift, state.anchor_v2)[0] > 4e-4
    soc, _ = Fusion(state, TUNING).fuse(1.0, np.array([0.92]), np.array([1e-4]))
    assert soc[0] == pytest.approx(0.92, abs=0.002), "a filter that has become surer leads"
    state = states(0.90, 0.40)
    for k in range(200):
        state.mean[SOC] = 0.40 if k % 50 == 49 else 0.90
        Fusion(state, TUNING).fuse(1.0, state.mean[SOC], np.array([4e-4]))
    assert state.count_soc[0] == 0.40


def test_the_count_grows_uncertain_with_charge_and_with_time():
    moved, waited = states(0.5, 0.5), states(0.5, 0.5)
    cell = PackedCell(load_cell())
    for state, current_c, dt_s in ((moved, 0.4, 3600.0), (waited, 0.0, 3600.0)):
        guard = InputGuard(cell, state, TUNING)
        Process(cell, state, TUNING, counts=True).predict(
            guard.check(dt_s, current_c * cell.model.capacity_ah, [3.7], [25.0])
        )
    offset_v2 = TUNING.counter_offset_c**2
    assert moved.count_soc[0] == pytest.approx(0.1)
    assert count_variance(moved.drift, moved.anchor_v2)[0] == pytest.approx(
        1e-4 + (0.4 * TUNING.counter_gain) ** 2 + offset_v2
    )
    assert count_variance(waited.drift, waited.anchor_v2)[0] == pytest.approx(1e-4 + offset_v2)
