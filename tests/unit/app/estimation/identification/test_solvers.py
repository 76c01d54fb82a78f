import numpy as np
import pytest

from app.estimation.identification.solvers import first_order


@pytest.mark.parametrize("n", [1, 2, 3, 10, 1000, 1025])
def test_blocked_recursion_equals_the_plain_one(n):
    rng = np.random.default_rng(n)
    decay, drive = rng.uniform(0.0, 1.0, n), rng.normal(size=n)
    expected, y = np.empty(n), 0.0
    for k in range(n):
        expected[k] = y = decay[k] * y + drive[k]
    np.testing.assert_allclose(first_order(decay, drive), expected, atol=1e-12)
