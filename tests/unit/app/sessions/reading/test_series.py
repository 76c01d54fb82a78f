import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.sessions.reading.series import find_gaps, reduce_samples

SAMPLES = st.lists(
    st.tuples(st.sampled_from([0.1, 0.1, 0.1, 0.1, 2.0]), st.floats(-5, 5) | st.just(np.nan)), min_size=1
)


@given(SAMPLES, st.integers(1, 50))
def test_extremes_order_and_number_of_points_hold_for_any_samples(samples, points: int) -> None:
    times_s = np.cumsum([step for step, _ in samples])
    values = np.array([value for _, value in samples])
    series = reduce_samples("x", "V", times_s, values, points)
    drawn = np.isfinite(series.minimum)
    assert drawn.sum() <= points or len(times_s) <= points
    assert (np.diff(series.time_s) > 0).all()
    assert (series.minimum[drawn] <= series.maximum[drawn]).all()
    if np.isfinite(values).any():
        assert series.minimum[drawn].min() == np.nanmin(values)
        assert series.maximum[drawn].max() == np.nanmax(values)
    assert len(series.time_s) == len(series.minimum) == len(series.maximum)


def test_each_gap_between_points_is_broken_by_one_empty_point() -> None:
    times_s = np.concatenate([start + np.arange(0, 10, 0.1) for start in (0, 100, 200)])
    series = reduce_samples("x", "", times_s, np.ones(300), 30)
    assert np.array(series.gaps) == pytest.approx(np.array([[9.9, 100], [109.9, 200]]))
    assert [round(float(t), 2) for t in series.time_s[np.isnan(series.minimum)]] == [54.95, 154.95]


@pytest.mark.parametrize(
    ("period_s", "missing", "is_gap"),
    [(0.1, 3, False), (0.1, 6, True), (0.04, 9, False), (1.0, 2, False), (1.0, 4, True)],
)
def test_a_gap_is_what_is_unusual_for_the_signal(period_s: float, missing: int, is_gap: bool) -> None:
    times_s = np.delete(np.arange(100) * period_s, np.arange(50, 50 + missing))
    assert (len(find_gaps(times_s)) == 1) is is_gap


def test_no_sample_is_no_point() -> None:
    series = reduce_samples("x", "", np.empty(0), np.empty(0), 10)
    assert (len(series.time_s), series.gaps) == (0, ())
