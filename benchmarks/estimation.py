"""How fast the filters run, side by side with peers in one process: `python -m benchmarks.estimation`.

One pass = one sample through all 96 cells, temperatures and look-ups over SOC and temperature included. Processor
time of one core, best of several rounds, so that other work on the machine counts as little as possible.
"""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.estimators import make_estimator
from app.estimation.filters.sigma_points import unscented
from app.estimation.filters.tables import OCV, OVERPOTENTIAL, R0, R1, CellTables
from tests.textbook_filters import additive_step, augmented_step

Row = tuple[str, str, str]
FloatArray = NDArray[np.float64]

N_CELLS = 96
DT_S = 0.1
ROUNDS = 15
MINUTE_STEPS = 600  # a minute at 10 Hz
RECORD_STEPS = 18_000  # half an hour


def best_s(work: Callable[[], object], times: int, rounds: int = ROUNDS) -> float:
    """Return the shortest mean processor time of one call [s]."""
    best = float("inf")
    for _ in range(rounds):
        began = time.process_time()
        for _ in range(times):
            work()
        best = min(best, (time.process_time() - began) / times)
    return best


def sample() -> tuple[FloatArray, FloatArray]:
    """Return voltages [V] and temperatures [degC] of 96 cells that differ a little."""
    rng = np.random.default_rng(0)
    return 3.8 + rng.normal(0.0, 0.01, N_CELLS), np.round(rng.uniform(25.0, 35.0, N_CELLS))


def pass_s(name: str) -> float:
    """Return the time of one pass of a filter over 96 cells [s]."""
    volts, degc = sample()
    estimator = make_estimator(name, load_cell(), N_CELLS)
    estimator.start(volts, degc, 0.0, soc=0.6)
    for _ in range(100):
        estimator.step(DT_S, 10.0, volts, degc)
    return best_s(lambda: estimator.step(DT_S, 10.0, volts, degc), 300, 60)


def record_s(name: str, n_steps: int, soc_only: bool = False) -> float:
    """Return the time to estimate a record of 96 cells in one call [s]; see `SocEstimator.run`."""
    volts, degc = sample()
    estimator = make_estimator(name, load_cell(), N_CELLS)
    estimator.start(volts, degc, 0.0, soc=0.6)
    current = 25.0 * np.random.default_rng(1).uniform(-1.0, 4.0, n_steps)
    arrays = np.full(n_steps, DT_S), current, np.tile(volts, (n_steps, 1)), np.tile(degc, (n_steps, 1))
    return best_s(lambda: estimator.run(*arrays, soc_only=soc_only), max(MINUTE_STEPS // n_steps, 1), 30)


def textbook_s(augmented: bool) -> float:
    """Return the time of a pass of a textbook filter, one cell after the other [s]."""
    cell = CellTables(load_cell())
    at = cell.place_temperature(np.array([25.0]))
    decay = np.concatenate(([1.0], np.exp(-DT_S / load_cell().tau_s[:, 0, 0])))
    per_a = np.concatenate(([-DT_S / 90_000.0], 1.0 - decay[1:]))

    def process(state: FloatArray, noise_a: float) -> FloatArray:
        return decay * state + per_a * (10.0 + noise_a)

    def output(state: FloatArray) -> float:
        c = cell.circuit(state[:1], at)[:, 0]
        over = np.arcsinh(10.0 / cell.model.overpotential_current_a)
        return float(c[OCV] - 10.0 * c[R0] - over * c[OVERPOTENTIAL] - c[R1 : R1 + 2] @ state[1:])

    mean, cov = np.array([0.6, 0.0, 0.0]), np.diag([1e-3, 10.0, 10.0])
    if augmented:
        rule = unscented(5)
        return N_CELLS * best_s(lambda: augmented_step(mean, cov, rule, process, 1.0, output, 0.03, 3.8), 20, 5)
    rule, noise = unscented(3), np.diag([1e-9, 1e-3, 1e-3])
    return N_CELLS * best_s(lambda: additive_step(mean, cov, rule, process, noise, output, 0.03, 3.8), 20, 5)


def filterpy_s() -> float | None:
    """Return the time of a pass of filterpy's UKF, one object a cell [s]; None where it is not installed."""
    if importlib.util.find_spec("filterpy") is None:
        return None
    from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

    model = load_cell()
    grid = np.linspace(0.0, 1.0, 1001)
    ocv = model.ocv.voltage(grid)
    decay = np.exp(-DT_S / model.tau_s[:, 0, 0])

    def process(x: FloatArray, dt: float, current_a: float) -> FloatArray:
        soc = x[0] - current_a * dt / 90_000.0
        return np.array([soc, *(decay * x[1:] + (1.0 - decay) * current_a)])

    def output(x: FloatArray, current_a: float) -> FloatArray:
        drop = 2.15e-3 * current_a + 0.96e-3 * x[1] + 0.6e-3 * x[2]
        return np.array([np.interp(x[0], grid, ocv) - drop])

    points = MerweScaledSigmaPoints(3, 0.1, 2.0, 0.0)
    filters = []
    for _ in range(N_CELLS):
        ukf = UnscentedKalmanFilter(3, 1, DT_S, output, process, points)
        ukf.x, ukf.P = np.array([0.6, 0.0, 0.0]), np.diag([1e-3, 10.0, 10.0])
        ukf.Q, ukf.R = np.diag([1e-9, 1e-3, 1e-3]), np.array([[0.03]])
        filters.append(ukf)
    measured = np.array([3.8])

    def one_pass() -> None:
        for ukf in filters:
            ukf.predict(current_a=10.0)
            ukf.update(measured, current_a=10.0)

    return best_s(one_pass, 1, 8)


def simdkalman_s() -> float | None:
    """Return the time of a pass of simdkalman over 96 series of a linear cell [s]; None where it is not installed."""
    if importlib.util.find_spec("simdkalman") is None:
        return None
    import simdkalman

    model = load_cell()
    decay = np.exp(-DT_S / model.tau_s[:, 0, 0])
    observation = np.array([[1.0, -0.96e-3, -0.6e-3]])
    noise = np.diag([1e-9, 1e-3, 1e-3])
    linear = simdkalman.KalmanFilter(np.diag([1.0, *decay]), noise, observation, np.array([[0.03]]))
    mean = np.tile([[0.6], [0.0], [0.0]], (N_CELLS, 1, 1))
    cov = np.tile(np.diag([1e-3, 10.0, 10.0]), (N_CELLS, 1, 1))
    measured = np.full((N_CELLS, 1, 1), 0.6)

    def one_pass() -> None:
        linear.update(*linear.predict_next(mean, cov), measured)

    return best_s(one_pass, 100)


def run() -> list[Row]:
    """Return the rows of the table: quantity, figure, method."""
    peer = filterpy_s()
    rows: list[Row] = []
    if peer is not None:
        rows.append(("filterpy UKF, 96 cells", _time(peer), "7 points, one Python object a cell"))
    linear = simdkalman_s()
    if linear is not None:
        rows.append(("simdkalman, 96 series", _time(linear), "a linear cell of 3 states: no OCV curve, no tables"))
    for name in ("cdkf", "fused"):
        seconds = pass_s(name)
        note = "everything `serve` does with a sample" if name == "fused" else "the filter alone, sigma and self-check"
        if peer is not None:
            note += f"; {peer / seconds:,.0f} times filterpy"
        rows.append((f"{name}, 96 cells, one call", _time(seconds), note))
        seconds = record_s(name, MINUTE_STEPS, soc_only=True) / MINUTE_STEPS
        rows.append(
            (
                f"{name}, 96 cells, in a record",
                _time(seconds),
                "a pass of a minute in one call, SOC and sigma: the engine alone",
            )
        )
    half_hour = f"{record_s('fused', RECORD_STEPS, soc_only=True):.3f} s"
    rows.append(("fused, 30 min at 10 Hz, SOC and sigma", half_hour, "96 cells estimated again, one call"))
    half_hour = f"{record_s('fused', RECORD_STEPS):.3f} s"
    rows.append(("fused, 30 min at 10 Hz, all", half_hour, "likewise, with all that a step answers: 110 MB"))
    rows.append(("7-point textbook UKF, 96 cells", _time(textbook_s(False)), "numpy, one cell after the other"))
    rows.append(("11-point augmented UKF, 96 cells", _time(textbook_s(True)), "the thesis's formulation, likewise"))
    return rows


def _time(seconds: float) -> str:
    return f"{seconds * 1e6:,.1f} us" if seconds < 1e-3 else f"{seconds * 1e3:,.2f} ms"


def main() -> None:
    """Print the table."""
    for what, figure, how in run():
        print(f"{what:40} {figure:>12}  {how}")


if __name__ == "__main__":
    main()
