import numpy as np
import pytest

from app.estimation.scoring import autocorrelation, score_innovations

DT_S = 0.1


def coloured(n: int, memory_s: float, seed: int = 3) -> np.ndarray:
    """Unit variance, exponential autocorrelation with this time constant."""
    rng = np.random.default_rng(seed)
    a = np.exp(-DT_S / memory_s)
    noise = rng.normal(size=n) * np.sqrt(1.0 - a * a)
    y = np.empty(n)
    y[0] = rng.normal()
    for k in range(1, n):
        y[k] = a * y[k - 1] + noise[k]
    return y


def score(y, sigma=1.0):
    return score_innovations(DT_S * np.arange(y.size), y, np.full(y.size, sigma))


def test_white_innovations_of_the_expected_size_pass_every_measure():
    found = score(np.random.default_rng(1).normal(0.0, 0.01, 20_000), 0.01)
    assert found.nis == pytest.approx(1.0, abs=0.05)
    assert found.innovation_white_share >= 0.8
    assert 0.3 < found.innovation_ljung_box < 2.0
    assert found.innovation_correlation_s == pytest.approx(DT_S, rel=0.3)


def test_innovations_that_last_are_found_and_timed():
    found = score(coloured(60_000, 5.0))
    assert found.innovation_white_share == 0.0
    assert found.innovation_ljung_box > 100.0
    assert found.innovation_correlation_s == pytest.approx(10.0, rel=0.25)  # both sides of an exponential


def test_a_bias_is_not_white():
    found = score(0.5 + np.random.default_rng(2).normal(size=5000))
    assert found.innovation_white_share == 0.0


def test_size_is_judged_apart_from_memory():
    found = score(np.random.default_rng(4).normal(0.0, 0.02, 20_000), 0.01)
    assert found.nis == pytest.approx(4.0, rel=0.05)
    assert found.innovation_white_share >= 0.8


def test_missing_innovations_are_passed_over_and_too_few_say_nothing():
    y = np.random.default_rng(5).normal(size=4000)
    y[::3] = np.nan
    assert score(y).nis == pytest.approx(1.0, abs=0.1)
    assert score(y[:200]) is None
    assert score(np.full(500, np.nan)) is None


def test_autocorrelation_is_the_sum_of_products_over_the_sum_of_squares():
    values = np.random.default_rng(6).normal(size=50)
    wanted = [np.sum(values[: 50 - k] * values[k:]) / np.sum(values**2) for k in range(8)]
    np.testing.assert_allclose(autocorrelation(values, 7), wanted, atol=1e-12)
