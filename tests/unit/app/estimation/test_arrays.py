import numpy as np
import pytest

from app.estimation.arrays import latest_at

NAN = float("nan")


def test_the_latest_value_holds_until_the_next_and_nothing_is_known_before_the_first():
    found = latest_at(np.array([0.0, 1.0, 1.9, 2.0, 9.0]), np.array([1.0, 2.0]), np.array([10.0, 20.0]))
    assert found == pytest.approx([NAN, 10.0, 10.0, 20.0, 20.0], nan_ok=True)


def test_a_row_of_cells_is_taken_together_and_of_two_at_one_time_the_last():
    found = latest_at(np.array([5.0, 0.0]), np.array([1.0, 1.0]), np.array([[1.0, 2.0], [3.0, 4.0]]))
    assert found == pytest.approx(np.array([[3.0, 4.0], [NAN, NAN]]), nan_ok=True)


@pytest.mark.parametrize("shape", [(0,), (0, 3)])
def test_of_no_values_nothing_is_known(shape):
    found = latest_at(np.array([0.0, 1.0]), np.zeros(0), np.zeros(shape))
    assert found.shape == (2, *shape[1:])
    assert np.isnan(found).all()
