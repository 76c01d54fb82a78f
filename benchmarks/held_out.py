"""The hard cases on cells and drives that nothing was tuned on: `python -m benchmarks.held_out --keep FOLDER`.

Physics of PyBaMM with parameter sets that took no part in choosing a number of the filters; models are identified from
slow test and pulses alone. The drives are a car's day in the manner of the WLTP and the current of the simulator's
endurance, both scaled to the cell. Needs the extra `voltwall[pybamm]` where the folder does not hold the recordings.
Columns as in `benchmarks/hard_cases.py`.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.estimation.identification.identify import identify
from app.estimation.recording.cell_recording import Recording
from app.sources.recordings.dataset import load_recording
from benchmarks.hard_cases import (
    AGED,
    FAR_OFF,
    HEADER,
    LITTLE_OFF,
    RIGHT,
    UNKNOWN,
    Row,
    judge,
    line,
    middles,
    with_gaps,
)
from benchmarks.simulated_race import drive
from tests.numeric.pybamm_cells import Cell, pulse_test, save, simulate, slow_test

FloatArray = NDArray[np.float64]

DT_S = 0.1
COLD_DEGC = 5.0
PHASES = ((16.0, 589.0), (21.0, 433.0), (27.0, 455.0), (36.0, 323.0))  # highest speed [m/s], length [s]
RACE_SEED, RACE_S = 7001, 1700.0
CELLS = {
    cell.name: (cell, full)
    for cell, full in (
        (Cell("Prada2013", 2.2915, 6.0, 1.3, is_isothermal=True), True),
        (Cell("Marquis2019", 0.8722, 3.0, 1.0), False),
        (Cell("Ecker2015", 0.1710, 5.0, 1.2), False),
        (Cell("NCA_Kim2011", 0.4830, 4.0, 1.0), False),
        (Cell("Ai2020", 2.4649, 4.0, 1.0), False),
        (Cell("ORegan2022", 5.0222, 4.0, 1.2), False),
        (Cell("OKane2022", 5.1056, 4.0, 1.2), True),
    )
}


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


def endurance(cell: Cell) -> FloatArray:
    """Return (n,) the current of a race of the simulator [A], as hard for this cell, at most 75 % of its charge."""
    time_s, current_a = np.array([(s.uptime_s, s.current_a) for s in drive(RACE_SEED, RACE_S)]).T
    current_a = np.interp(np.arange(time_s[0], time_s[-1], DT_S), time_s, current_a)
    rates_c = current_a * cell.peak_c / np.percentile(np.abs(current_a), 99.9)
    rates_c = np.clip(rates_c, -0.35 * cell.peak_c, 1.1 * cell.peak_c)
    return np.asarray(cell.capacity_ah * rates_c * min(1.0, 0.75 * 3600.0 / (rates_c.sum() * DT_S)))


def recordings(cell: Cell, full: bool, keep: Path) -> dict[str, Recording]:
    """Return tests and drives of a cell by name, from the folder where they are kept."""
    work: dict[str, Callable[[], Recording]] = {
        "slow": lambda: slow_test(cell, False),
        "pulses25": lambda: pulse_test(cell, 25.0, full),
        "pulses40": lambda: pulse_test(cell, 40.0, full),
        "endurance1": lambda: simulate(cell, endurance(cell), DT_S, 0.93, 22.0, full, "endurance"),
        "wltp1": lambda: simulate(cell, road(cell, 1), DT_S, 0.88, 22.0, full, "road"),
        "wltp2cold": lambda: simulate(cell, road(cell, 2), DT_S, 0.9, COLD_DEGC, full, "road, cold"),
    }
    found = {}
    for name, simulated in work.items():
        path = keep / f"{cell.name}_{name}.csv.gz"
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            save(simulated(), path)
        found[name] = load_recording(path)
    return found


def rows(cell: Cell, full: bool, keep: Path) -> Iterator[Row]:
    """Yield the rows of a cell."""
    tests = recordings(cell, full, keep)
    model = identify([tests["slow"]], [tests["pulses25"], tests["pulses40"]], [], 2).model
    drives = [tests["endurance1"], tests["wltp1"]]
    aged = replace(model, capacity_ah=model.capacity_ah / AGED)
    yield Row("right start", cell.name, False, model, drives, RIGHT)
    yield Row("50 points off at rest", cell.name, False, model, drives, FAR_OFF)
    yield Row("3 to 8 points off at rest", cell.name, False, model, drives, LITTLE_OFF)
    yield Row("in mid-drive, SOC unknown", cell.name, False, model, [m for d in drives for m in middles(d)], UNKNOWN)
    yield Row("capacity 10 % too large in the cell file", cell.name, False, aged, drives, RIGHT)
    yield Row("gaps of 2 s in 20 s", cell.name, False, model, [with_gaps(d) for d in drives], RIGHT)
    yield Row("5 degC, model of 25 and 40 degC", cell.name, False, model, [tests["wltp2cold"]], RIGHT)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keep", type=Path, required=True, help="folder for the recordings")
    parser.add_argument("--cells", nargs="+", choices=tuple(CELLS), default=tuple(CELLS))
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--signs", type=int, default=4, help="signs of the sensor errors, for a quicker look")
    args = parser.parse_args()
    print(HEADER, flush=True)
    with ProcessPoolExecutor(args.jobs) as pool:
        for name in args.cells:
            of_cell = list(rows(*CELLS[name], args.keep))
            for row, scores in zip(of_cell, pool.map(judge, of_cell, [args.signs] * len(of_cell)), strict=True):
                print(line(row, scores), flush=True)


if __name__ == "__main__":
    main()
