"""Bands are honest on runs that took no part in tuning: held-out races of the simulator, drives of shared data."""

from pathlib import Path

import pytest

from tests.numeric.prediction_score import race_scores
from tests.numeric.voltage_ahead import drive_scores

DATA = Path(__file__).parents[3] / "shared" / "data"
LEAST = 0.8  # of 90 % claimed: a race has few independent moments
TUNED_ON = "(training)"


@pytest.mark.timeout(600)
def test_the_truth_of_a_race_is_within_the_bands():
    scores = race_scores("clean-endurance", [41], 60.0, seconds=500.0)
    for name in ("power discharge  1 s", "power discharge 10 s", "soc_min at load [s]"):
        assert len(scores[name].truth) >= 6
        assert scores[name].coverage() >= LEAST, name
    assert scores["energy left"].coverage() >= LEAST
    energy = scores["energy left"]
    assert all(abs(middle / truth - 1.0) < 0.06 for middle, truth in zip(energy.middle, energy.truth, strict=True))


@pytest.mark.timeout(600)
@pytest.mark.skipif(not DATA.is_dir(), reason=f"{DATA} is absent")
def test_the_voltage_of_drives_is_within_the_band_ten_seconds_ahead():
    for name, found in drive_scores(DATA):
        assert TUNED_ON in name or found[1] >= 0.85, name
