import numpy as np

from app.estimation.health.learned import CAPACITY_SIGMA_MAX_FRAC, RESISTANCE_SIGMA_MAX, learned


def test_what_was_learned_counts_where_its_sigma_is_small_and_the_cell_file_elsewhere():
    nominal = np.full(3, 25.0)
    limit_ah = CAPACITY_SIGMA_MAX_FRAC * 25.0
    found = learned(
        nominal,
        np.array([22.0, 21.0, 24.0]),
        np.array([0.5 * limit_ah, 1.1 * limit_ah, 0.9 * limit_ah]),
        np.array([1.5, 1.4, 1.2]),
        RESISTANCE_SIGMA_MAX * np.array([1.5, 0.5, 0.9]),
    )
    assert found.capacity_ah.tolist() == [22.0, 25.0, 24.0]
    assert found.has_capacity.tolist() == [True, False, True]
    assert found.resistance_factor.tolist() == [1.0, 1.4, 1.2]
    assert found.has_resistance.tolist() == [False, True, True]
