"""Rows of a pack: 96 cells, scaled from one race, through the pipeline that `serve` and an import use."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.battery.battery import Battery
from app.estimation.filters.estimators import make_estimator
from app.estimation.recording.cell_recording import Recording
from app.live.pipeline import Pipeline
from app.live.prediction import Predictor
from app.sources.items import TableItem
from app.sources.table_source import TableSource
from benchmarks.accuracy_drives import Folders, model_of, recording, without
from tests.numeric.judgement import VOLTAGE_NOISE_V, disturbed

FloatArray = NDArray[np.float64]

SEGMENTS: Final = (12,) * 8
CAPACITY, RESISTANCE, CHARGE = 0.03, 0.15, 0.01  # largest difference from the race's cell; of the SOC in points
SEED: Final = 35
GOAL, GOAL_NAMED = 0.55, 60
SIGNS: Final = ((-1.0, -1.0), (1.0, 1.0))  # gain and offset: two, since all cells share the current
HEADER: Final = """| race | goal | RMSE | all cells equal | goal | weakest named | within 3 sigma |
| --- | --- | --- | --- | --- | --- | --- |"""


def cells_of(race: Recording, slow: Recording) -> tuple[FloatArray, FloatArray]:
    """Return (n, 96) SOC and voltage of cells whose charge, drop and SOC are those of a race, scaled.

        z_k = z_0 + s_k - (z_0 - z) / c_k,  v_k = OCV(z_k) + r_k (v - OCV(z))

    OCV is the mean of the slow test's discharge and charge.
    """
    rng, n_cells = np.random.default_rng(SEED), sum(SEGMENTS)
    capacity, resistance, start = (
        rng.uniform(-1.0, 1.0, n_cells) * most + middle
        for most, middle in ((CAPACITY, 1.0), (RESISTANCE, 1.0), (CHARGE, 0.0))
    )
    grid = np.linspace(0.02, 0.98, 961)
    c_a = np.nanmax(np.abs(slow.current_a))
    ways = [slow.current_a > 0.5 * c_a, slow.current_a < -0.5 * c_a]
    sides = [np.interp(grid, *np.sort((slow.soc[way], slow.voltage_v[way]))) for way in ways]
    ocv = np.mean(sides, axis=0)
    z = race.soc[:, None]
    soc = z[0] + start - (z[0] - z) / capacity
    drop = race.voltage_v[:, None] - np.interp(z, grid, ocv)
    return soc, np.interp(soc, grid, ocv) + resistance * drop


def judge(cell: str, sign: tuple[float, float], folders: Folders) -> FloatArray:
    """Return the figures of a pack of a cell's race, the model identified without it: see `line`."""
    race, tests = recording(f"{cell}_train", folders), without(f"{cell}_train")
    model = model_of(tests, folders)
    soc, clean_v = cells_of(race, recording(tests.slow[0], folders))
    n_cells = soc.shape[1]
    voltage_v = np.round(clean_v + VOLTAGE_NOISE_V * np.random.default_rng(SEED).normal(size=clean_v.shape), 4)
    _, current_a = disturbed(race, model.capacity_ah, *sign)
    pipeline = Pipeline(
        TableSource(Battery("pack", SEGMENTS, sensors=tuple((k,) for k in range(n_cells)))),
        lambda: make_estimator("fused", model, n_cells),
        filter_name="fused",
        cell_name=model.name,
        predictor=Predictor(model, SEGMENTS, predicts=False),
    )
    estimated, sigma = np.empty((2, *soc.shape))
    for k, time_s in enumerate(race.time_s.tolist()):
        degc = np.full(n_cells, race.temperature_degc[k])
        numbers = np.concatenate(([current_a[k], np.nan], voltage_v[k], degc))
        at_ns = round(1e9 * time_s)
        estimates = pipeline.feed(TableItem(at_ns, at_ns, numbers), publishes=False).estimates
        assert estimates is not None
        estimated[k], sigma[k] = estimates.soc, estimates.soc_sigma
        pipeline.predict()
    apart, truly = (100.0 * (values - values.mean(axis=1, keepdims=True)) for values in (estimated, soc))
    return np.array(
        (
            np.sqrt(np.mean((apart - truly) ** 2)),
            np.sqrt(np.mean(truly**2)),
            100.0 * np.mean(estimated.argmin(axis=1) == soc.argmin(axis=1)),
            100.0 * np.mean(np.abs(estimated - soc) <= 3.0 * sigma),
        )
    )


def line(cell: str, errors: list[FloatArray]) -> str:
    """Return a row of Markdown from the figures with each sign."""
    rmse, equal, named, inside = np.array(errors).T
    return (
        f"| {cell} | {GOAL} | {rmse.min():.2f}/{rmse.max():.2f} | {equal[0]:.2f} | {GOAL_NAMED} % | "
        f"{named.min():.0f}/{named.max():.0f} % | {inside.min():.1f} % |"
    )
