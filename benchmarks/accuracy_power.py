"""Rows of power: what the product promises at moments of a race, and what PyBaMM's cell then holds."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.commands.filter_run import run_filter
from app.estimation.filters.estimators import make_estimator
from app.estimation.prediction.constant_current import OperatingPoint
from app.estimation.prediction.power_along import branch_currents, power_along, voltage_ahead
from benchmarks.accuracy_drives import Tests, model_of, recording
from benchmarks.pybamm_recordings import HORIZONS_S, OWN
from tests.numeric.judgement import SIGNS, disturbed

FloatArray = NDArray[np.float64]

DRIVES: Final = {"pulses alone": (), "pulses and a drive": ("train",)}  # what the model is identified from
HEADER: Final = """| cell | model from | for | moments | in band | held less / more | promised over held | band, half |
| --- | --- | --- | --- | --- | --- | --- | --- |"""


def first_of(cell: str, source: str, horizon_s: float) -> str:
    """Return the beginning of a row of Markdown."""
    return f"| {cell} | {source} | {horizon_s:g} s |"


def first_of_rows() -> list[str]:
    """Return the beginnings of all rows."""
    return [first_of(*key) for key in product(OWN, DRIVES, HORIZONS_S)]


def judge(cell: str, source: str, folder: Path) -> list[str]:
    """Return a row of Markdown for each horizon: moments of a race from a right start, all signs."""
    names = tuple(f"{cell}_{drive}" for drive in DRIVES[source])
    model = model_of(Tests((f"{cell}_c30",), (f"{cell}_hppc", f"{cell}_hppc40"), names), (folder,))
    race = recording(f"{cell}_race", (folder,))
    truth = np.loadtxt(folder / f"{cell}_power.csv", delimiter=",", skiprows=1)
    model = replace(model, v_min_v=float(truth[0, 1]))  # a slow test may end below it
    at = np.searchsorted(race.time_s, truth[:, 0], side="right") - 1
    errors: dict[float, list[FloatArray]] = {horizon_s: [] for horizon_s in HORIZONS_S}
    for sign in SIGNS:
        voltage, current = disturbed(race, model.capacity_ah, *sign)
        sensed = replace(race, voltage_v=voltage, current_a=current)
        estimator = make_estimator("fused", model, 1)
        run = run_filter(estimator, sensed, model.capacity_ah, float(race.soc[0]), None, model)
        branches = branch_currents(model, sensed.step_s, sensed.current_a, run.soc, sensed.temperature_degc)
        states = OperatingPoint(run.soc, branches, sensed.temperature_degc)
        columns = sensed.time_s, sensed.current_a, sensed.voltage_v
        scale = voltage_ahead(model, *columns, states, run.soc_sigma).scale
        for power in power_along(model, states.of(at), run.soc_sigma[at], scale[at], HORIZONS_S):
            if power.direction == "discharge":
                held = truth[:, 2 + HORIZONS_S.index(power.horizon_s)]
                errors[power.horizon_s].append(np.array((power.low_w, power.power_w, power.high_w, held)))
    rows = []
    for horizon_s, of_horizon in errors.items():
        low, promised_w, high, held_w = np.concatenate(of_horizon, axis=1)
        over, half = promised_w / held_w, 50.0 * np.median((high - low) / held_w)
        shares = (100.0 * np.mean(share) for share in ((held_w >= low) & (held_w <= high), held_w < low, held_w > high))
        inside, less, more = (f"{share:.0f} %" for share in shares)
        rows.append(
            f"{first_of(cell, source, horizon_s)} {held_w.size} | {inside} | {less}/{more} | "
            f"x {np.median(over):.2f}, {over.min():.2f} to {over.max():.2f} | {half:.0f} % |"
        )
    return rows
