import numpy as np
import pytest

from app.estimation.identification.solvers import first_order, non_negative_least_squares


@pytest.mark.parametrize("n", [1, 2, 3, 10, 1000, 1025])
def test_blocked_recursion_equals_the_plain_one(n):
    rng = np.random.default_rng(n)
    decay, drive = rng.uniform(0.0, 1.0, n), rng.normal(size=n)
    expected, y = np.empty(n), 0.0
    for k in range(n):
        expected[k] = y = decay[k] * y + drive[k]
    np.testing.assert_allclose(first_order(decay, drive), expected, atol=1e-12)


def problem(seed, n=12, rows=60):
    rng = np.random.default_rng(seed)
    design, y = rng.normal(size=(rows, n)), rng.normal(size=rows)
    return design, y, design.T @ design, design.T @ y


@pytest.mark.parametrize("seed", range(20))
def test_solution_is_the_constrained_minimum(seed):
    _, _, gram, moment = problem(seed)
    is_free = np.arange(12) >= 9
    x = non_negative_least_squares(gram, moment, is_free)
    gradient = moment - gram @ x
    assert (x[:9] >= 0.0).all()
    assert np.abs(gradient[is_free | (x > 0)]).max() < 1e-8
    assert gradient[:9].max() < 1e-8


def test_agrees_with_scipy():
    optimize = pytest.importorskip("scipy.optimize")
    for seed in range(5):
        design, y, gram, moment = problem(seed)
        x = non_negative_least_squares(gram, moment, np.zeros(12, dtype=bool))
        np.testing.assert_allclose(x, optimize.nnls(design, y)[0], atol=1e-9)


def test_columns_of_very_different_size_do_not_matter():
    design, y, *_ = problem(3)
    scale = 10.0 ** np.linspace(-6, 6, 12)
    plain = non_negative_least_squares(design.T @ design, design.T @ y, np.zeros(12, dtype=bool))
    wide = design * scale
    scaled = non_negative_least_squares(wide.T @ wide, wide.T @ y, np.zeros(12, dtype=bool))
    np.testing.assert_allclose(scaled * scale, plain, rtol=1e-6, atol=1e-12)
