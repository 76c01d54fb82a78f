"""Bands are honest on runs that took no part in tuning: held-out races of the simulator, drives of shared data."""

from pathlib import Path

import pytest

from tests.campaign import SIZE, campaign, of_size
from tests.numeric.prediction_score import race_scores
from tests.numeric.voltage_ahead import drive_scores

DATA = Path(__file__).parents[3] / "shared" / "data"
LEAST = 0.8  # least coverage of a 90 % band: a race has few independent moments
RACE_S = of_size(500, 500, 2000, 10_000)
EVERY_S = 60
DRIVE_S = of_size(600, 3600, 3600, 10**9)
POWERS = ("power discharge  1 s", "power discharge 10 s", "soc_min at load [s]")


@pytest.mark.skipif(SIZE == "sample", reason="each prediction is driven to its end: in the campaign")
@campaign(120, 600, 1200)
def test_the_truth_of_a_race_is_within_the_bands(tell):
    scores = race_scores("clean-endurance", [41], EVERY_S, RACE_S, {*POWERS, "energy left"})
    for name in POWERS:
        assert len(scores[name].truth) >= 5
        assert scores[name].coverage() >= LEAST, name
    energy = scores["energy left"]
    assert len(energy.truth) >= 3
    assert energy.coverage() >= LEAST
    assert all(abs(middle / truth - 1.0) < 0.06 for middle, truth in zip(energy.middle, energy.truth, strict=True))
    found = ", ".join(f"{name} {100 * scores[name].coverage():.0f} %" for name in (*POWERS, "energy left"))
    tell(f"predictions of a race: in the band of 90 %: {found}")


@campaign(120, 600, 1200)
@pytest.mark.skipif(not DATA.is_dir(), reason=f"{DATA} is absent")
def test_the_voltage_of_drives_is_within_the_band_ten_seconds_ahead(tell):
    scores = dict(drive_scores(DATA, DRIVE_S, with_training=False))
    assert len(scores) >= 4
    for name, (rows, inside, *_) in scores.items():
        assert rows > 100, name
        assert inside >= 0.85, name
    found = ", ".join(f"{name} {100 * inside:.0f} %" for name, (_, inside, *_) in scores.items())
    tell(f"voltage of drives 10 s ahead: in the band of 90 %: {found}")
