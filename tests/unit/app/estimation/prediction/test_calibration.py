import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.prediction.calibration import SCALE, VoltageForecast, adapted, scale_along
from app.estimation.prediction.constant_current import CellKnowledge, OperatingPoint
from tests.open_loop import simulate

CELL = load_cell("samsung-25r-10p")


def point(soc, n=4):
    return OperatingPoint(np.full(n, soc), np.zeros((CELL.n_rc, n)), np.full(n, 25.0))


def forecast_once(off_v, current_a=100.0):
    """Foretell a constant current from rest; the cells come out so far off."""
    forecast, time_s = VoltageForecast(CELL), np.arange(0.0, 10.2, 0.1)
    _, voltage_v = simulate(CELL, time_s, np.full(time_s.size, current_a), np.full(time_s.size, 25.0), 0.6)
    forecast.begin(point(0.6), CellKnowledge())
    for k in range(1, time_s.size):
        forecast.step(0.1, current_a, voltage_v[k] + off_v * np.ones(4))
    return forecast.scale


def test_a_hit_narrows_and_a_miss_widens():
    assert SCALE[0] < forecast_once(0.0) < 1.0
    assert forecast_once(0.5) > 1.1
    assert forecast_once(np.array([0.5, 0.0, 0.0, 0.0])) == pytest.approx(adapted(1.0, 0.25))


def test_at_rest_and_over_a_hole_nothing_is_learned():
    assert forecast_once(0.5, current_a=0.0) == 1.0
    forecast = VoltageForecast(CELL)
    forecast.begin(point(0.6), CellKnowledge())
    forecast.step(60.0, 100.0, np.full(4, 2.6))
    assert forecast.scale == 1.0


def test_a_missing_cell_is_no_miss():
    assert forecast_once(np.full(4, np.nan)) == 1.0


@pytest.mark.parametrize("error", [0.4, 1.0, 3.0])
@pytest.mark.parametrize("tails", ["gaussian", "laplace"])
def test_one_in_ten_misses_whatever_the_error_looks_like(error, tails):
    rng = np.random.default_rng(3)
    n = 40_000
    off = error * (rng.normal(size=n) if tails == "gaussian" else rng.laplace(size=n))
    scale = scale_along(np.arange(n) * 1.0, np.full(n, 50.0), off, CELL.capacity_ah)
    late = slice(n // 4, None)
    missed = float((np.abs(off) > 1.645 * scale)[late].mean())
    if error == 0.4:
        assert missed < 0.1, "bands are never narrower than four fifths of what the model says"
    else:
        assert missed == pytest.approx(0.1, abs=0.02)


def test_the_scale_of_a_row_knows_nothing_of_that_row_or_later():
    off = np.zeros(100)
    off[60:] = 10.0
    scale = scale_along(np.arange(100.0), np.full(100, 50.0), off, CELL.capacity_ah)
    np.testing.assert_array_equal(
        scale[:61], scale_along(np.arange(100.0), np.full(100, 50.0), np.zeros(100), 25.0)[:61]
    )
    assert scale[62] > scale[60]
