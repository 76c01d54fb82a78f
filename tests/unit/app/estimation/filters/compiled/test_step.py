"""The compiled engine gives the numbers of the numpy one, for every filter and shape of model."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("numba", reason="numba is an optional extra")

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.errors import EstimatorError, ShapeError
from app.estimation.filters.estimators import make_estimator

N = 12
BASE = load_cell()
MODELS = {
    "two pairs": BASE,
    "hysteresis": replace(BASE, hysteresis_v=0.02),
    "asinh": replace(BASE, overpotential_v=np.full(BASE.r0_ohm.shape, 0.01), overpotential_current_a=25.0),
    "tau over soc": replace(BASE, tau_s=BASE.tau_s * np.linspace(0.8, 1.2, BASE.soc_grid.size)),
    "one temperature": replace(
        BASE,
        temperature_grid_degc=[25.0],
        r0_ohm=BASE.r0_ohm[3:4],
        r_ohm=BASE.r_ohm[:, 3:4],
        tau_s=BASE.tau_s[:, 3:4],
        overpotential_v=None,
    ),
    "no pair": replace(BASE, r_ohm=BASE.r_ohm[:0], tau_s=BASE.tau_s[:0]),
    "four pairs": replace(BASE, r_ohm=BASE.r_ohm[[0, 1, 0, 1]], tau_s=BASE.tau_s[[0, 1, 0, 1]] * 1.0),
}


def samples(seed: int, n_steps: int):
    """A drive with missing samples, outliers, gaps and temperatures outside the tables."""
    rng = np.random.default_rng(seed)
    degc = rng.uniform(-15.0, 65.0, N)
    for k in range(n_steps):
        volts = 3.75 - 0.0001 * k + rng.normal(0.0, 0.02, N)
        if k % 7 == 0:
            volts[k % N] = np.nan
        if k % 11 == 0:
            volts[:3] = 2.0
        if 100 < k < 160:
            volts[5] = 4.2
        if k % 40 == 0:
            degc = np.where(rng.random(N) < 0.2, np.nan, rng.uniform(-15.0, 65.0, N))
        yield float(rng.choice([0.0, 0.1, 0.1, 1.0, 30.0])), float(rng.normal() * 80.0), volts, degc


# The fusion and the tangent do not see the shape of the model; every pair of the list is a kernel to compile.
PAIRS = [(name, model) for model in MODELS for name in ("ukf", "cdkf")]
PAIRS += [(name, model) for model in ("two pairs", "tau over soc", "four pairs") for name in ("fused", "ekf")]
PAIRS += [("ekf", "asinh")]


@pytest.mark.parametrize(("name", "model"), PAIRS)
def test_compiled_equals_numpy(name, model):
    slow = make_estimator(name, MODELS[model], N, engine="numpy")
    fast = make_estimator(name, MODELS[model], N, engine="numba")
    for estimator in (slow, fast):
        estimator.start(np.full(N, 3.8), np.full(N, 20.0), 0.0, soc=np.linspace(0.2, 0.9, N))
    for dt, current, volts, degc in samples(4, 300):
        expected, got = slow.step(dt, current, volts, degc), fast.step(dt, current, volts, degc)
        np.testing.assert_allclose(got.numbers, expected.numbers, rtol=0, atol=1e-12)
    np.testing.assert_allclose(fast.state_cov, slow.state_cov, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(fast.counted_soc, slow.counted_soc, rtol=0, atol=1e-12)


def test_a_record_equals_its_steps():
    rows = list(samples(9, 120))
    dt, current = np.array([r[0] for r in rows]), np.array([r[1] for r in rows])
    current[17] = np.nan
    volts, degc = np.array([r[2] for r in rows]), np.array([r[3] for r in rows])
    results = []
    for engine in ("numpy", "numba"):
        estimator = make_estimator("fused", BASE, N, engine=engine)
        estimator.start(volts[0], degc[0], 0.0, soc=0.5)
        results.append(estimator.run(dt, current, volts, degc))
    np.testing.assert_allclose(results[1].soc, results[0].soc, rtol=0, atol=1e-12)
    assert (results[1].accepted == results[0].accepted).all()


def test_compiled_refuses_what_numpy_refuses():
    estimator = make_estimator("fused", BASE, N, engine="numba")
    with pytest.raises(EstimatorError, match="not been started"):
        estimator.step(0.1, 0.0, np.full(N, 3.7), np.full(N, 25.0))
    estimator.start(np.full(N, 3.7), np.full(N, 25.0), 0.0)
    with pytest.raises(ShapeError):
        estimator.step(0.1, 0.0, np.full(N - 1, 3.7), np.full(N, 25.0))
    with pytest.raises(EstimatorError):
        estimator.step(-0.1, 0.0, np.full(N, 3.7), np.full(N, 25.0))
