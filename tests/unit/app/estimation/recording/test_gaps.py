"""What may have flowed while nothing was measured."""

import numpy as np
import pytest

from app.estimation.recording.gaps import GapWatch, bridge_gap


def watched(current_a, dt_s=0.1):
    """Return a watch that has seen these currents."""
    watch = GapWatch()
    assert [watch.step(dt_s, float(i), 40.0) for i in current_a] == [None] * len(current_a)
    return watch


def test_a_short_gap_takes_the_mean_of_its_ends_and_the_spread_of_a_drive():
    gap = bridge_gap(4.0, (100.0, 50.0), 80.0, 60.0, 40.0)
    assert gap.current_a == 75.0
    assert gap.sigma_ah == pytest.approx(80.0 * 4.0 / 3600.0)


def test_a_short_gap_of_many_changes_is_known_better_than_one_change_held():
    assert bridge_gap(40.0, (0.0, 0.0), 80.0, 60.0, 40.0).sigma_ah < 80.0 * 40.0 / 3600.0


@pytest.mark.parametrize(
    ("ends_a", "taken_a"), [((100.0, 5.0), 5.0), ((-3.0, -8.0), -3.0), ((100.0, -20.0), 0.0), ((900.0, 900.0), 0.0)]
)
def test_a_long_gap_takes_the_smaller_end_and_none_where_that_cannot_be(ends_a, taken_a):
    gap = bridge_gap(90.0, ends_a, 80.0, 60.0, 40.0)
    assert gap.current_a == taken_a
    assert gap.sigma_ah == pytest.approx(60.0 * 90.0 / 3600.0)


def test_a_stream_has_no_gap_until_its_step_is_known_nor_where_a_frame_is_missing():
    watch = GapWatch()
    assert watch.step(30.0, 10.0, 40.0) is None
    assert watched(np.zeros(100)).step(0.3, 10.0, 40.0) is None


def test_a_gap_in_a_drive_leaves_the_charge_unsure_and_one_in_a_rest_does_not():
    drive = 60.0 + 50.0 * np.sign(np.sin(np.arange(1200) / 7.0))
    driven, rested = watched(drive), watched(np.zeros(1200))
    gap = driven.step(20.0, 60.0, 40.0)
    assert gap is not None
    assert gap.sigma_ah > 0.05
    assert rested.step(20.0, 0.0, 40.0).sigma_ah == 0.0
    assert driven.usual_step_s == pytest.approx(0.1)
