import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.errors import ShapeError
from app.estimation.filters.estimators import make_estimator
from app.estimation.filters.start import per_cell
from tests.open_loop import simulate

CELL = load_cell()


@pytest.mark.parametrize("soc", [0.2, 0.5, 0.9])
def test_a_rested_cell_starts_at_its_soc(soc):
    estimator = make_estimator("cdkf", CELL, 1, engine="numpy")
    estimator.start(CELL.ocv.voltage(np.array([soc])), [25.0], 0.0)
    assert estimator.state_mean[0, 0] == pytest.approx(soc, abs=1e-3)
    assert estimator.state_mean[1:, 0].tolist() == [0.0] * CELL.n_rc


def test_a_start_under_load_covers_what_is_not_known_of_the_rc_pairs():
    current = np.concatenate((np.zeros(10), np.full(400, 100.0)))
    soc, volts = simulate(CELL, 0.5 * np.arange(410), current, np.full(410, 25.0), 0.8)
    for row in (15, 60, 409):
        estimator = make_estimator("cdkf", CELL, 1, engine="numpy")
        estimator.start(volts[row : row + 1], [25.0], 100.0)
        error = estimator.state_mean[0, 0] - soc[row]
        assert abs(error) < 2.0 * np.sqrt(estimator.state_cov[0, 0, 0])
        assert (np.linalg.eigvalsh(estimator.state_cov[0]) > 0.0).all()


def test_a_cell_that_is_not_measured_starts_where_the_others_are_and_knows_nothing():
    estimator = make_estimator("cdkf", CELL, 3, engine="numpy")
    volts = CELL.ocv.voltage(np.array([0.6, 0.6, 0.6]))
    volts[1] = np.nan
    estimator.start(volts, [25.0] * 3, 0.0)
    assert estimator.state_mean[0, 1] == pytest.approx(0.6, abs=1e-3)
    assert estimator.state_cov[1, 0, 0] == pytest.approx(0.25)


def test_of_a_soc_handed_over_the_count_takes_it_and_the_filter_of_a_fusion_does_not():
    estimator = make_estimator("fused", CELL, 2, engine="numpy")
    estimator.start(CELL.ocv.voltage(np.array([0.6, 0.6])), [25.0] * 2, 0.0, soc=[0.4, np.nan])
    assert estimator.counted_soc == pytest.approx([0.4, 0.6], abs=1e-3)
    assert estimator.state_mean[0] == pytest.approx([0.6, 0.6], abs=1e-3)


def test_a_scalar_is_for_all_cells_and_another_shape_is_refused():
    assert per_cell("soc", 0.5, 0.0, 3).tolist() == [0.5] * 3
    assert per_cell("soc", None, 0.7, 2).tolist() == [0.7] * 2
    with pytest.raises(ShapeError):
        per_cell("soc", [0.1, 0.2], 0.0, 3)


def told(soc, rest_soc, current_a=0.0, sigma=None, heard=True):
    """Return SOC and sigma that the count alone reports after it was told a SOC while the voltage said another."""
    estimator = make_estimator("coulomb", CELL, 1, engine="numpy")
    volts = CELL.ocv.voltage(np.array([rest_soc])) if heard else np.array([np.nan])
    estimator.start(volts, [25.0], current_a, [soc], sigma)
    found = estimator.step(0.0, current_a, volts, [25.0])
    return found.soc[0], found.soc_sigma[0]


def test_a_soc_told_without_a_sigma_is_as_sure_as_the_rested_voltage_allows():
    assert told(0.63, 0.60) == pytest.approx((0.63, 0.03), abs=1e-3)
    _, confirmed = told(0.61, 0.60)
    assert confirmed < 0.004
    for unheard in (told(0.63, 0.60, current_a=CELL.capacity_ah), told(0.63, 0.60, heard=False), told(0.90, 0.60)):
        assert unheard[1] == pytest.approx(confirmed)


def test_a_sigma_that_was_told_with_the_soc_is_kept():
    assert told(0.63, 0.60, sigma=[0.005])[1] == pytest.approx(0.005, rel=0.01)
    assert told(0.61, 0.60, sigma=[0.05])[1] == pytest.approx(0.05, rel=0.01)
