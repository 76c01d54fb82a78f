"""Sigma means what it says, and the fusion is as good as the better of its parts, on cells that are not the model."""

from dataclasses import replace

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.cell_model.ocv import OcvCurve
from app.estimation.filters.estimators import make_estimator
from tests.campaign import of_size
from tests.open_loop import simulate

N_RUNS = of_size(12, 24, 48, 96)
DURATION_S = 1200.0


def disturbed_runs(seed: int):
    """Races of cells whose resistances, time constants, capacity and OCV differ from the model's, and sensors that err.

    Yields time, true SOC, measured current, measured voltage and temperature.
    """
    rng = np.random.default_rng(seed)
    model = load_cell()
    for _ in range(N_RUNS):
        bump = rng.normal(0.0, 4e-3) + rng.normal(0.0, 3e-3) * np.sin(model.ocv.soc * 9.0 + rng.uniform(0, 6))
        cell = replace(
            model,
            ocv=OcvCurve(model.ocv.soc, np.maximum.accumulate(model.ocv.voltage_v + bump)),
            r0_ohm=model.r0_ohm * rng.uniform(0.93, 1.07),
            r_ohm=model.r_ohm * rng.uniform(0.85, 1.15, (2, 1, 1)),
            tau_s=model.tau_s * rng.uniform(0.8, 1.25, (2, 1, 1)),
            capacity_ah=25.0 * rng.uniform(0.99, 1.01),
        )
        n = int(DURATION_S / 0.1)
        bursts = np.repeat(rng.choice([0.0, 0.2, 1.0, 0.7, -0.3], n // 12 + 1), 12)[:n]
        current = bursts * 25.0 * rng.uniform(2.0, 4.0)
        time = np.arange(n) * 0.1
        degc = 25.0 + 12.0 * time / DURATION_S
        soc, volts = simulate(cell, time, current, degc, 0.92)
        sensed = current * (1.0 + rng.uniform(-0.005, 0.005)) + rng.uniform(-0.17, 0.17) + rng.normal(0.0, 0.3, n)
        yield time, soc, sensed, np.round(volts + rng.normal(0.0, 1.2e-3, n), 4), degc


def run(name: str, sample, start_soc: float, start_sigma: float | None = None):
    time, _, current, volts, degc = sample
    estimator = make_estimator(name, load_cell(), 1)
    estimator.start(volts[:1], degc[:1], float(current[0]), soc=start_soc, soc_sigma=start_sigma)
    return estimator.run(np.diff(time, prepend=0.0), current, volts[:, None], degc[:, None])


@pytest.fixture(scope="module")
def samples():
    return list(disturbed_runs(8))


@pytest.mark.parametrize("name", ["fused", "cdkf"])
@pytest.mark.parametrize("off", [0.0, -0.5])
def test_truth_lies_within_three_sigma_and_sigma_is_not_three_times_too_wide(samples, name, off):
    rng = np.random.default_rng(21)
    inside, normalised = [], []
    for sample in samples:
        record = run(name, sample, 0.92 + off + rng.normal(0.0, 8e-3), 8e-3 if name == "fused" else None)
        settled = sample[0] > 60.0
        error = (record.soc[:, 0] - sample[1])[settled]
        sigma = record.soc_sigma[settled, 0]
        inside.append(np.mean(np.abs(error) < 3.0 * sigma))
        normalised.append(np.mean((error / sigma) ** 2))
    assert np.mean(inside) > 0.95
    assert 1.0 / 9.0 < np.mean(normalised) < 3.0


def test_fused_is_on_average_at_least_as_good_as_either_part(samples):
    rng = np.random.default_rng(5)
    errors = []
    for sample in samples:
        time, soc, current, _, _ = sample
        start = 0.92 + rng.normal(0.0, 4e-3)
        counted = start - np.cumsum(current * np.diff(time, prepend=0.0)) / 90000.0
        parts = counted, run("cdkf", sample, start).soc[:, 0], run("fused", sample, start, 4e-3).soc[:, 0]
        errors.append([np.sqrt(np.mean((part - soc) ** 2)) for part in parts])
    by_count, by_filter, fused = np.mean(errors, axis=0)
    assert fused < min(by_count, by_filter) + 1e-3
    assert (np.array(errors)[:, 2] < np.max(errors, axis=1) + 1e-3).all()
