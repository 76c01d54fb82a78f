"""Runs of the thesis's load patterns: its own filter on its own voltages, and the product's filter on other cells."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.cell_model.ocv import OcvCurve
from app.estimation.filters.estimators import make_estimator
from app.estimation.filters.sigma_points import unscented
from app.estimation.prediction.driver_soc import DriverSoc
from benchmarks import thesis_filter as thesis
from benchmarks.thesis_curves import load_curves

FloatArray = NDArray[np.float64]

THESIS_PASSES = 113_605
RUN_MAX_S = 7200.0
DT_S = 0.1
SNR = 10.0 ** (-40.0 / 20.0)  # 40 dB


class ThesisRun(NamedTuple):
    """SOC the thesis's filter gives (kept, n), the charge really drawn (kept,), processor time [s]."""

    estimate: FloatArray
    truth: FloatArray
    seconds: float


def thesis_run(name: str, n_cells: int, passes: int = THESIS_PASSES, keep: int = 500) -> ThesisRun:
    """Run the thesis's filter on the thesis's voltages: curves under load at the magnitude of the current."""
    load = thesis.pattern(name)
    current = 25.0 * load[np.minimum(np.arange(passes) * load.size // passes, load.size - 1)]
    truth = 1.0 - np.cumsum(current) * thesis.STEP_S / 90_000.0
    curves = load_curves()
    drawn = np.linspace(1.0, 0.0, passes)  # the script lets every run end empty, whatever its length
    level = np.clip(np.rint(np.abs(current) / 25.0), 1, 10).astype(int) - 1
    clean = curves[level, np.rint(1000.0 * drawn).astype(int)]
    rng = np.random.default_rng(4)
    volts = clean[:, None] * (1.0 + SNR * rng.standard_normal((passes, n_cells)))
    mean = np.tile([1.0, 0.0, 0.0], (n_cells, 1))
    cov = np.tile(np.diag(thesis.P0), (n_cells, 1, 1))
    kept = np.zeros((-(-passes // keep), n_cells))
    rule = unscented(5)
    weights = rule.spread, rule.centre_mean, rule.centre_cov, rule.weight
    thesis.run(mean.copy(), cov.copy(), current[:1], volts[:1], curves, *weights, 1, np.zeros((1, n_cells)))
    began = time.process_time()
    thesis.run(mean, cov, current, volts, curves, *weights, keep, kept)
    return ThesisRun(kept, truth[::keep], time.process_time() - began)


class PatternRun(NamedTuple):
    """A pattern on cells that are not the model; SOC is (k, n), `seconds` the processor time of the filter."""

    time_s: FloatArray
    load_c: FloatArray
    truth: FloatArray
    estimate: FloatArray
    driver_percent: FloatArray
    seconds: float


def pattern_run(name: str, n_cells: int, start_soc: float = 0.5) -> PatternRun:
    """Repeat a load pattern until the cells are empty, two hours at most, at 10 Hz, with the start SOC wrong by a half.

    A slice lasts as long as in the thesis; the thesis plays the pattern once and takes the cells for empty after it.
    """
    load = thesis.pattern(name)
    slice_s = 3600.0 / load.sum() / load.size
    n = int(min(0.97 * 3600.0 * load.size / load.sum(), RUN_MAX_S) / DT_S)
    time_s: FloatArray = DT_S * np.arange(n, dtype=np.float64)
    load_c: FloatArray = load[(time_s / slice_s).astype(int) % load.size]
    current = 25.0 * load_c
    rng = np.random.default_rng(7)
    model = load_cell()
    degc = np.full(n, 30.0)
    cells = [
        replace(
            model,
            capacity_ah=25.0 * rng.normal(1.0, 0.01),
            r0_ohm=model.r0_ohm * rng.normal(1.0, 0.05),
            r_ohm=model.r_ohm * rng.normal(1.0, 0.1, (2, 1, 1)),
            tau_s=model.tau_s * rng.uniform(0.8, 1.25, (2, 1, 1)),
            ocv=OcvCurve(model.ocv.soc, model.ocv.voltage_v + rng.normal(0.0, 3e-3)),
        )
        for _ in range(n_cells)
    ]
    decay = np.exp(-DT_S / np.array([cell.tau_s[:, 0, 0] for cell in cells]))
    branch = np.zeros((n, n_cells, 2))
    for k in range(1, n):
        branch[k] = decay * branch[k - 1] + (1.0 - decay) * current[k]
    moved = np.concatenate(([0.0], np.cumsum(np.where(current < 0, model.coulombic_efficiency, 1.0) * current)[1:]))
    truth, volts = np.empty((n, n_cells)), np.empty((n, n_cells))
    for k, cell in enumerate(cells):
        truth[:, k] = 0.995 - abs(rng.normal(0.0, 0.005)) - moved * DT_S / (3600.0 * cell.capacity_ah)
        clean = cell.terminal_voltage(truth[:, k], branch[:, k].T, current, degc)
        volts[:, k] = clean * (1.0 + SNR * rng.standard_normal(n))
    estimator = make_estimator("fused", model, n_cells)
    estimator.start(volts[0], np.full(n_cells, 30.0), float(current[0]), soc=start_soc)
    began = time.process_time()
    record = estimator.run(np.diff(time_s, prepend=0.0), current, volts, np.full((n, n_cells), 30.0))
    seconds = time.process_time() - began
    driver = DriverSoc(n_cells)
    percent = np.array([cast(int, driver.step(soc).percent) for soc in record.soc], dtype=np.float64)
    return PatternRun(np.asarray(time_s, dtype=np.float64), load_c, truth, record.soc, percent, seconds)
