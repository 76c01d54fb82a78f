"""The Gaussian process against cells that the simulator aged: seeds that had no part in choosing its constants."""

import numpy as np
import pytest

from app.season.cells.ageing import ageing
from tests.unit.app.season.season_of import season


@pytest.mark.parametrize(("name", "sigma", "missing"), [("capacity", 0.015, 0.5), ("resistance", 0.02, 0.1)])
def test_the_band_holds_the_truth_of_the_past_and_of_90_days_ahead(name, sigma, missing):
    past, ahead = [], []
    for seed in (200, 201):
        made = season(seed, n_cells=48)
        truth = getattr(made, name)
        values, sigmas = made.measured(truth, sigma, missing)
        found = ageing(made.days[:-1], made.charge_ah[:-1], values, sigmas, made.days, made.charge_ah)
        inside = (truth >= found.low) & (truth <= found.high)
        past.append(inside[:-1].mean())
        ahead.append(inside[-1].mean())
        assert np.sqrt(np.mean((found.mean - truth) ** 2)) < sigma / 2
        assert (found.sigma[-1] > found.sigma[-2]).all()
    assert np.mean(past) >= 0.88
    assert np.mean(ahead) >= 0.85


def test_of_a_cell_that_is_hardly_measured_nothing_is_said():
    made = season(202, n_cells=3)
    values, sigmas = made.measured(made.capacity, 0.015, 0.0)
    values[5:, 1] = np.nan
    found = ageing(made.days[:-1], made.charge_ah[:-1], values, sigmas, made.days, made.charge_ah)
    assert np.isnan(found.mean[:, 1]).all()
    assert np.isfinite(found.mean[:, [0, 2]]).all()
