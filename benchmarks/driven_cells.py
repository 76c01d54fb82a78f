"""Cells of PyBaMM under drives: a car's day in the manner of the WLTP, the simulator's endurance, a cold road.

The drives are scaled to the cell; its model is identified from slow test and pulses alone. Needs the extra
`voltwall[pybamm]` where the folder does not hold the recordings.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.estimation.identification.identify import identify
from app.estimation.recording.cell_recording import Recording
from app.sources.recordings.dataset import load_recording
from benchmarks.hard_cases import (
    AGED,
    FAR_OFF,
    LITTLE_OFF,
    RIGHT,
    UNKNOWN,
    Row,
    add_arguments,
    middles,
    print_table,
    with_gaps,
)
from benchmarks.simulated_race import drive
from tests.numeric.pybamm_cells import Cell, pulse_test, save, simulate, slow_test

FloatArray = NDArray[np.float64]

DT_S = 0.1
PHASES = ((16.0, 589.0), (21.0, 433.0), (27.0, 455.0), (36.0, 323.0))  # highest speed [m/s], length [s]
RACE_S = 1700.0


@dataclass(frozen=True)
class Drives:
    """How cells are driven; starts are (SOC, degC).

    Attributes:
        race_seed: of the simulator's endurance.
        road_seeds: of the warm and of the cold road.
        race: start of the endurance.
        road: start of the warm road.
        cold: start of the cold one.
    """

    race_seed: int
    road_seeds: tuple[int, int]
    race: tuple[float, float]
    road: tuple[float, float]
    cold: tuple[float, float]


def road(cell: Cell, seed: int) -> FloatArray:
    """Return (n,) the current of half an hour on the road [A]: four phases of rising speed, braking recovered."""
    rng = np.random.default_rng(1000 + seed)
    speed_mps = [np.zeros(300)]
    for top_mps, lasts_s in PHASES:
        passed_s, now_mps = 0.0, 0.0
        while passed_s < lasts_s:
            goal_mps = top_mps * rng.uniform(0.35, 1.0) * (rng.random() < 0.8)
            rate, hold_s = rng.uniform(0.3, 1.3), rng.uniform(4.0, 25.0)
            n, m = max(int(abs(goal_mps - now_mps) / rate / DT_S), 1), int(hold_s / DT_S)
            speed_mps.append(np.linspace(now_mps, goal_mps, n))
            speed_mps.append(goal_mps + 0.12 * np.sqrt(DT_S) * np.cumsum(rng.normal(size=m)) * (goal_mps > 0.0))
            passed_s += (n + m) * DT_S
            now_mps = float(speed_mps[-1][-1])
        speed_mps.append(np.linspace(now_mps, 0.0, int(max(now_mps, 0.1) / DT_S)))
        speed_mps.append(np.zeros(80))
    v = np.maximum(np.concatenate(speed_mps), 0.0)
    acceleration = np.convolve(np.gradient(v, DT_S), np.ones(5) / 5.0, "same")
    power_w = v * (1500.0 * acceleration + 150.0 + 0.4 * v * v)
    power_w = np.where(power_w < 0.0, 0.6 * power_w, power_w)
    rates_c = np.clip(power_w / np.percentile(power_w, 99.7) * 0.62 * cell.peak_c, -0.3 * cell.peak_c, cell.peak_c)
    rates_c = np.concatenate((rates_c * min(1.0, 0.72 * 3600.0 / (rates_c.sum() * DT_S)), np.zeros(300)))
    return np.asarray(cell.capacity_ah * rates_c)


@cache
def race_current(seed: int) -> FloatArray:
    """Return (n,) the current of a race of the simulator, every DT_S [A]."""
    time_s, current_a = np.array([(s.uptime_s, s.current_a) for s in drive(seed, RACE_S)]).T
    found: FloatArray = np.interp(np.arange(time_s[0], time_s[-1], DT_S), time_s, current_a)
    return found


def endurance(cell: Cell, seed: int) -> FloatArray:
    """Return (n,) the current of a race of the simulator [A], as hard for this cell, at most 75 % of its charge."""
    current_a = race_current(seed)
    rates_c = current_a * cell.peak_c / np.percentile(np.abs(current_a), 99.9)
    rates_c = np.clip(rates_c, -0.35 * cell.peak_c, 1.1 * cell.peak_c)
    return np.asarray(cell.capacity_ah * rates_c * min(1.0, 0.75 * 3600.0 / (rates_c.sum() * DT_S)))


def recordings(cell: Cell, full: bool, drives: Drives, keep: Path) -> Iterator[tuple[str, Recording]]:
    """Yield tests and drives of a cell by name, from the folder where they are kept or else simulated into it."""
    warm, cold = (road(cell, seed) for seed in drives.road_seeds)
    work: dict[str, Callable[[], Recording]] = {
        "slow": lambda: slow_test(cell, False),
        "pulses25": lambda: pulse_test(cell, 25.0, full),
        "pulses40": lambda: pulse_test(cell, 40.0, full),
        "endurance1": lambda: simulate(cell, endurance(cell, drives.race_seed), DT_S, *drives.race, full, "endurance"),
        "wltp1": lambda: simulate(cell, warm, DT_S, *drives.road, full, "road"),
        "wltp2cold": lambda: simulate(cell, cold, DT_S, *drives.cold, full, "road, cold"),
    }
    for name, simulated in work.items():
        path = keep / f"{cell.name}_{name}.csv.gz"
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            save(simulated(), path)
        yield name, load_recording(path)


def rows(cell: Cell, full: bool, drives: Drives, keep: Path, is_training: bool) -> Iterator[Row]:
    """Yield the rows of a cell."""
    tests = dict(recordings(cell, full, drives, keep))
    model = identify([tests["slow"]], [tests["pulses25"], tests["pulses40"]], [], 2).model
    driven = [tests["endurance1"], tests["wltp1"]]
    aged = replace(model, capacity_ah=model.capacity_ah / AGED)
    for what, of, runs, starts in (
        ("right start", model, driven, RIGHT),
        ("50 points off at rest", model, driven, FAR_OFF),
        ("3 to 8 points off at rest", model, driven, LITTLE_OFF),
        ("in mid-drive, SOC unknown", model, [m for d in driven for m in middles(d)], UNKNOWN),
        ("capacity 10 % too large in the cell file", aged, driven, RIGHT),
        ("gaps of 2 s in 20 s", model, [with_gaps(d) for d in driven], RIGHT),
        ("cold, model of 25 and 40 degC", model, [tests["wltp2cold"]], RIGHT),
    ):
        yield Row(what, cell.name, is_training, of, runs, starts)


def main(about: str | None, cells: Mapping[str, tuple[Cell, bool]], drives: Drives, is_training: bool) -> None:
    """Print the table of some cells, each with whether its full physics are simulated."""
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keep", type=Path, required=True, help="folder for the recordings")
    parser.add_argument("--cells", nargs="+", choices=tuple(cells), default=tuple(cells))
    add_arguments(parser)
    args = parser.parse_args()
    print_table((row for name in args.cells for row in rows(*cells[name], drives, args.keep, is_training)), args)
