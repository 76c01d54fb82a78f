"""The estimator on cells and drives that nothing was tuned on: `python -m benchmarks.held_out --keep FOLDER`.

Parameter sets of PyBaMM that took no part in choosing a number of the filters, under the simulator's endurance, a car
on the road (in the manner of the WLTP) and a cold road, each scaled to the cell; models are identified from slow test
and pulses alone. Every run is what `voltwall identify` and `voltwall estimate` make of it with their defaults and the
sensor errors of a car (see `tests/numeric/judgement.py`). Per row: RMSE in points of SOC, median and worst over starts
and signs; share of time within three sigma; share in which the model is called valid. Needs the extra
`voltwall[pybamm]` where FOLDER does not hold the recordings.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.commands.filter_run import run_filter
from app.estimation.cell_model.circuit import CellModel
from app.estimation.filters.estimators import make_estimator
from app.estimation.identification.identify import identify
from app.estimation.recording.cell_recording import Recording
from app.sources.recordings.dataset import load_recording
from benchmarks.accuracy import MIDDLES
from firmware_protocol.framing import Frame, FrameDecoder
from firmware_protocol.memory_map import FIELDS
from firmware_protocol.messages import Data, MessageType
from simulator.library import find_scenario
from simulator.scenario_player import ScenarioPlayer
from tests.numeric.judgement import SIGNS, disturbed, part, rows_of
from tests.numeric.pybamm_cells import Cell, pulse_test, save, simulate, slow_test

FloatArray = NDArray[np.float64]

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
RACE_SEED, WARM_SEED, COLD_SEED = 7001, 1, 2
RACE_START, WARM_START, COLD_START = (0.93, 22.0), (0.88, 22.0), (0.9, 5.0)  # SOC, degC
RACE_S = 1700.0
DT_S = 0.1
PHASES = ((16.0, 589.0), (21.0, 433.0), (27.0, 455.0), (36.0, 323.0))  # highest speed [m/s], length [s]
RIGHT = (0.0,)  # starts: SOC off by so much, None = unknown
UNKNOWN = (None,)
FAR_OFF = (-0.5,)
LITTLE_OFF = (-0.08, -0.05, -0.03, 0.03, 0.05)
AGED = 0.9
GAP_S, GAP_EVERY_S = 2.0, 20.0


@dataclass(frozen=True)
class Row:
    """Runs of one cell model from several starts."""

    what: str
    cell: str
    model: CellModel
    recordings: Sequence[Recording]
    starts: Sequence[float | None]


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
def race_current() -> FloatArray:
    """Return (n,) the current that the simulated car reports over its endurance, every DT_S [A]."""
    player = ScenarioPlayer(find_scenario("clean-endurance"), seed=RACE_SEED, step_s=0.05)
    decoder, field = FrameDecoder(), FIELDS["i_fs"]
    rows: list[tuple[float, float]] = []

    def take(data: bytes) -> None:
        for frame in decoder.feed(data):
            if isinstance(frame, Frame) and frame.type == MessageType.DATA:
                for window in Data.from_body(frame.body).windows:
                    if window.offset <= field.offset < window.offset + len(window.data):
                        raw = field.unpack(window.data, -window.offset)[0]
                        rows.append((frame.uptime_ms / 1000, raw * field.scale))

    player.simulation.serial_out = take
    player.simulation.run_until(0.2)
    player.simulation.receive(b"x")
    while player.simulation.now_s < RACE_S and not player.is_over:
        player.run(1.0)
    time_s, current_a = np.array(rows).T
    return np.asarray(np.interp(np.arange(time_s[0], time_s[-1], DT_S), time_s, current_a))


def endurance(cell: Cell) -> FloatArray:
    """Return (n,) the current of the race [A], as hard for this cell, at most 75 % of its charge."""
    current_a = race_current()
    rates_c = current_a * cell.peak_c / np.percentile(np.abs(current_a), 99.9)
    rates_c = np.clip(rates_c, -0.35 * cell.peak_c, 1.1 * cell.peak_c)
    return np.asarray(cell.capacity_ah * rates_c * min(1.0, 0.75 * 3600.0 / (rates_c.sum() * DT_S)))


def recordings(cell: Cell, full: bool, keep: Path) -> dict[str, Recording]:
    """Return tests and drives of a cell by name, from the folder where they are kept or else simulated into it."""
    work: dict[str, Callable[[], Recording]] = {
        "slow": lambda: slow_test(cell, False),
        "pulses25": lambda: pulse_test(cell, 25.0, full),
        "pulses40": lambda: pulse_test(cell, 40.0, full),
        "endurance1": lambda: simulate(cell, endurance(cell), DT_S, *RACE_START, full, "endurance"),
        "wltp1": lambda: simulate(cell, road(cell, WARM_SEED), DT_S, *WARM_START, full, "road"),
        "wltp2cold": lambda: simulate(cell, road(cell, COLD_SEED), DT_S, *COLD_START, full, "road, cold"),
    }
    for name, simulated in work.items():
        path = keep / f"{cell.name}_{name}.csv.gz"
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            save(simulated(), path)
    return {name: load_recording(keep / f"{cell.name}_{name}.csv.gz") for name in work}


def with_gaps(recording: Recording) -> Recording:
    """Return the recording without the rows of the last GAP_S of every GAP_EVERY_S."""
    return rows_of(recording, (recording.time_s - recording.time_s[0]) % GAP_EVERY_S < GAP_EVERY_S - GAP_S)


def middles(recording: Recording) -> list[Recording]:
    """Return what is left of a run for a filter that wakes up in it."""
    lasted_s = float(recording.time_s[-1] - recording.time_s[0])
    return [part(recording, share * lasted_s, (share + 0.45) * lasted_s) for share in MIDDLES]


def rows(cell: Cell, full: bool, keep: Path) -> Iterator[Row]:
    """Yield the rows of a cell."""
    tests = recordings(cell, full, keep)
    model = identify([tests["slow"]], [tests["pulses25"], tests["pulses40"]], [], 2).model
    driven = [tests["endurance1"], tests["wltp1"]]
    aged = replace(model, capacity_ah=model.capacity_ah / AGED)
    yield Row("right start", cell.name, model, driven, RIGHT)
    yield Row("50 points off at rest", cell.name, model, driven, FAR_OFF)
    yield Row("3 to 8 points off at rest", cell.name, model, driven, LITTLE_OFF)
    yield Row("in mid-drive, SOC unknown", cell.name, model, [m for d in driven for m in middles(d)], UNKNOWN)
    yield Row("capacity 10 % too large in the cell file", cell.name, aged, driven, RIGHT)
    yield Row("gaps of 2 s in 20 s", cell.name, model, [with_gaps(d) for d in driven], RIGHT)
    yield Row("cold, model of 25 and 40 degC", cell.name, model, [tests["wltp2cold"]], RIGHT)


def judge(row: Row) -> str:
    """Return a row of the table in Markdown, over all its recordings, starts and signs of the sensor errors."""
    scores, model = [], row.model
    for recording in row.recordings:
        for off in row.starts:
            first = float(recording.soc[0])
            soc = None if off is None else first + (off if 0.0 <= first + off <= 1.0 else -off)
            for sign in SIGNS:
                voltage, current = disturbed(recording, model.capacity_ah, *sign)
                run = replace(recording, voltage_v=voltage, current_a=current)
                found = run_filter(make_estimator("fused", model, 1), run, model.capacity_ah, soc)
                error = found.soc - recording.soc
                known = np.isfinite(error)
                inside = np.mean(np.abs(error) <= 3.0 * found.soc_sigma, where=known)
                scores.append((100.0 * np.sqrt(np.mean(error[known] ** 2)), inside, found.model_valid_frac))
    rmse, inside, valid = np.array(scores).T
    return (
        f"| {row.what} | {row.cell} | {np.median(rmse):.2f} / {rmse.max():.2f} | {100.0 * inside.mean():.0f} % "
        f"| {100.0 * valid.mean():.0f} % |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keep", type=Path, required=True, help="folder for the recordings")
    parser.add_argument("--cells", nargs="+", choices=tuple(CELLS), default=tuple(CELLS))
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    args = parser.parse_args()
    print("| case | cell | RMSE | within 3 sigma | model valid |\n| --- | --- | --- | --- | --- |", flush=True)
    with ProcessPoolExecutor(args.jobs) as pool:
        for line in pool.map(judge, (row for name in args.cells for row in rows(*CELLS[name], args.keep))):
            print(line, flush=True)


if __name__ == "__main__":
    main()
