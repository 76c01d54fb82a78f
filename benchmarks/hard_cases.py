"""Where a cell model or a start is wrong: the product beside a textbook EKF, `python -m benchmarks.hard_cases`.

Every run is what `voltwall identify` and `voltwall estimate` make of the shared data with their defaults, with the
sensor errors of a car (all four signs, see `tests/numeric/judgement.py`). Per row: RMSE in points of SOC, median and
worst over starts and signs, of the product and of `benchmarks/plain_ekf.py` with the same cell file and start (an
unknown SOC is read off the first voltage); share of time within three sigma, of both; share in which the product calls
its model valid. Rows marked "training" took part in choosing the tuning.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.commands.cell_commands.filter_run import run_filter
from app.estimation.cell_model.cell_file import load_cell
from app.estimation.cell_model.circuit import CellModel
from app.estimation.filters.estimators import make_estimator
from app.estimation.identification.identify import identify
from app.estimation.recording.cell_recording import Recording
from app.live.estimator_start import MASTER_SOC_SIGMA
from app.sources.recordings.dataset import load_recording
from benchmarks.accuracy import DATA, MIDDLES, part
from benchmarks.plain_ekf import plain_ekf
from benchmarks.simulated_race import drive
from tests.numeric.judgement import SIGNS, disturbed

FloatArray = NDArray[np.float64]

UNKNOWN = (None,)
RIGHT = (0.0,)
FAR_OFF = (-0.5,)
LITTLE_OFF = (-0.08, -0.05, -0.03, 0.03, 0.05)
LITTLE_LOW = (-0.08, -0.05, -0.03)  # where the run begins full
GAP_S = 2.0
GAP_EVERY_S = 20.0
PAUSE_C = 0.05  # below this current a drive pauses
PAUSE_DRIVEN_S = 60.0
PAUSE_LEAST_S = 2.0
PAUSE_RUN_S = 400.0  # of a run that begins in a pause
PAUSES = 6  # of a drive
AGED = 0.9
CAR_SEED = 41
CAR_STARTS_S = (30.0, 240.0, 500.0)
CAR_RUN_S = 240.0
CAR_LOAD_A = 100.0
CAR_CELLS = (0, 50, 95)
MASTER_OFF = (-0.01, 0.01)


@dataclass(frozen=True)
class Row:
    """Runs of one cell model from several starts: SOC off by so much, None = unknown."""

    what: str
    run: str
    is_training: bool
    model: CellModel
    recordings: Sequence[Recording]
    starts: Sequence[float | None] = RIGHT
    soc_sigma: float | None = None  # said with the start
    since_s: float = 0.0  # rows before are not scored
    is_sensed: bool = False  # the recordings hold the errors of their sensors


@dataclass(frozen=True)
class Score:
    """What one run gave, RMSE in points of SOC, shares 0..1."""

    fused: float
    ekf: float
    inside: float
    ekf_inside: float
    valid: float


def with_gaps(recording: Recording) -> Recording:
    """Return the recording without the rows of the last GAP_S of every GAP_EVERY_S."""
    keep = (recording.time_s - recording.time_s[0]) % GAP_EVERY_S < GAP_EVERY_S - GAP_S
    names = ("time_s", "current_a", "voltage_v", "temperature_degc", "soc")
    return replace(recording, **{name: getattr(recording, name)[keep] for name in names})


def middles(recording: Recording) -> list[Recording]:
    """Return what is left of a run for a filter that wakes up in it."""
    lasted_s = float(recording.time_s[-1] - recording.time_s[0])
    return [part(recording, share * lasted_s, (share + 0.45) * lasted_s) for share in MIDDLES]


def pauses(recording: Recording, capacity_ah: float) -> list[Recording]:
    """Return what follows the beginnings of some pauses of a drive, in which the cell still relaxes."""
    time_s = recording.time_s - recording.time_s[0]
    rests = np.abs(recording.current_a) < PAUSE_C * capacity_ah
    begins, ends = (np.flatnonzero(edge) + 1 for edge in (rests[1:] & ~rests[:-1], ~rests[1:] & rests[:-1]))
    found = []
    for k in begins[time_s[begins] >= PAUSE_DRIVEN_S].tolist():
        end = next((time_s[e] for e in ends.tolist() if e > k), time_s[-1])
        if end - time_s[k] >= PAUSE_LEAST_S and np.isfinite(recording.soc[k]):
            found.append(part(recording, time_s[k], time_s[k] + PAUSE_RUN_S))
    return found[:: max(1, len(found) // PAUSES)]


def start_soc(recording: Recording, off: float | None) -> float | None:
    """Return the SOC that is told, on the other side where it would leave 0..1."""
    if off is None:
        return None
    first = float(recording.soc[0])
    return first + (off if 0.0 <= first + off <= 1.0 else -off)


def score(soc: FloatArray, sigma: FloatArray, reference: FloatArray) -> tuple[float, float]:
    """Return RMSE in points and the share of time within three sigma."""
    error = soc - reference
    known = np.isfinite(error)
    return float(100.0 * np.sqrt(np.mean(error[known] ** 2))), float(np.mean(np.abs(error) <= 3.0 * sigma, where=known))


def judge(row: Row, n_signs: int = len(SIGNS)) -> list[Score]:
    """Return the scores of all runs of a row, with the first `n_signs` signs of the sensor errors."""
    scores, model = [], row.model
    for recording in row.recordings:
        sensed = [disturbed(recording, model.capacity_ah, *sign) for sign in SIGNS[:n_signs]]
        if row.is_sensed:
            sensed = [(recording.voltage_v, recording.current_a)]
        scored = recording.time_s - recording.time_s[0] >= row.since_s
        told = [(start_soc(recording, off), *one) for off in row.starts for one in sensed]
        first = [float(model.ocv.soc_at(voltage[0])) if soc is None else soc for soc, voltage, _ in told]
        voltage_v, current_a = np.array([one[1] for one in told]).T, np.array([one[2] for one in told]).T
        degc = np.broadcast_to(np.nan_to_num(recording.temperature_degc, nan=25.0)[:, None], voltage_v.shape)
        by_ekf = plain_ekf(model, recording.step_s, current_a, voltage_v, degc, first)
        for k, (soc, voltage, current) in enumerate(told):
            run = replace(recording, voltage_v=voltage, current_a=current)
            found = run_filter(make_estimator("fused", model, 1), run, model.capacity_ah, soc, row.soc_sigma)
            truth = np.where(scored, recording.soc, np.nan)
            fused, inside = score(found.soc, found.soc_sigma, truth)
            ekf, ekf_inside = score(by_ekf[0][:, k], by_ekf[1][:, k], truth)
            scores.append(Score(fused, ekf, inside, ekf_inside, found.model_valid_frac))
    return scores


def panasonic_rows(folder: Path) -> Iterator[Row]:
    """Yield the rows of the measured cell."""
    slow, warm, *colds = (
        load_recording(folder / f"{name}.csv.gz")
        for name in ("c20_ocv_25degC", *(f"hppc5pulse_{degc}degC" for degc in ("25", "10", "0", "n10")))
    )
    cycle, cool, cold, us06 = (
        load_recording(folder / f"{name}degC.csv.gz") for name in ("cycle1_25", "cycle1_10", "cycle1_0", "us06_25")
    )
    pulses = identify([slow], [warm], [], 2).model
    driven = identify([slow], [warm], [cycle], 2).model
    everywhere = identify([slow], [warm, *colds], [cycle], 2).model
    aged = replace(driven, capacity_ah=driven.capacity_ah / AGED)
    yield Row("right start", "US06", True, driven, [us06])
    yield Row("right start", "Cycle 1, model of pulses", True, pulses, [cycle])
    yield Row("50 points off at rest", "US06", True, driven, [us06], FAR_OFF)
    yield Row("50 points off", "Cycle 1, model of pulses", True, pulses, [cycle], FAR_OFF)
    yield Row("3 to 8 points low at rest", "US06", True, driven, [us06], LITTLE_LOW)
    yield Row("in mid-drive, SOC unknown", "US06", True, driven, middles(us06), UNKNOWN)
    yield Row("in mid-drive, SOC unknown", "Cycle 1, model of pulses", True, pulses, middles(cycle), UNKNOWN)
    yield Row("capacity 10 % too large in the cell file", "US06", True, aged, [us06])
    yield Row("gaps of 2 s in 20 s", "US06", True, driven, [with_gaps(us06)])
    for run, is_training, model, driving in (
        ("US06", False, driven, us06),
        ("Cycle 1, model of pulses", True, pulses, cycle),
        ("Cycle 1 at 10 degC", True, everywhere, cool),
        ("Cycle 1 at 0 degC", True, everywhere, cold),
    ):
        yield Row("in pauses of a drive, right start", run, is_training, model, pauses(driving, model.capacity_ah))
    yield Row("10 degC, model of 25 degC", "Cycle 1", True, driven, [cool])
    yield Row("0 degC, model of 25 degC", "Cycle 1", True, driven, [cold])
    yield Row("10 degC, pulses down to -10 degC", "Cycle 1", True, everywhere, [cool])
    yield Row("0 degC, pulses down to -10 degC", "Cycle 1", True, everywhere, [cold])


def physics_rows(folder: Path) -> Iterator[Row]:
    """Yield the rows of the simulated cells, models of slow tests and pulses."""
    for cell in ("Mohtat2020", "Chen2020", "Prada2013"):
        slow, train = (load_recording(folder / f"{cell}_{name}.csv.gz") for name in ("c30", "train"))
        pulses = [load_recording(path) for path in sorted(folder.glob(f"{cell}_hppc*.csv.gz"))]
        model = identify([slow], pulses, [], 2).model
        name = cell.removesuffix("2020").replace("Prada2013", "LFP (Prada)")
        yield Row("right start", name, True, model, [train])
        yield Row("50 points off at rest", name, True, model, [train], FAR_OFF)
        yield Row("3 to 8 points off at rest", name, True, model, [train], LITTLE_OFF)
        yield Row("in mid-drive, SOC unknown", name, True, model, middles(train), UNKNOWN)
        aged = replace(model, capacity_ah=model.capacity_ah / AGED)
        yield Row("capacity 10 % too large in the cell file", name, True, aged, [train])
        yield Row("gaps of 2 s in 20 s", name, True, model, [with_gaps(train)])


def car_rows() -> Iterator[Row]:
    """Yield the rows of the simulated car, which is read from a moment of a race at which much current flows."""
    model = load_cell("samsung-25r-10p")
    samples = list(drive(CAR_SEED, CAR_STARTS_S[-1] + 2.0 * CAR_RUN_S))
    time_s, current_a = np.array([(s.uptime_s, s.current_a) for s in samples]).T
    recordings = []
    for begin_s in CAR_STARTS_S:
        loaded = int(np.argmax((time_s >= begin_s) & (current_a > CAR_LOAD_A)))
        rows = slice(loaded, int(np.searchsorted(time_s, time_s[loaded] + CAR_RUN_S)))
        for cell in CAR_CELLS:
            volts, soc = (
                np.array([getattr(s, name)[cell] for s in samples[rows]]) for name in ("voltages_v", "true_soc")
            )
            degc = np.full_like(volts, float(np.mean(samples[loaded].temperatures_degc)))
            recordings.append(Recording("simulated car", time_s[rows], current_a[rows], volts, degc, soc, notes=()))
    for what, starts in (
        ("from 12 s on, master's SOC 1 point off", MASTER_OFF),
        ("from 12 s on, SOC unknown", UNKNOWN),
    ):
        yield Row(what, "simulated car", True, model, recordings, starts, MASTER_SOC_SIGMA, 12.0, is_sensed=True)


def line(row: Row, scores: Sequence[Score]) -> str:
    """Return a line of the table, in Markdown."""
    fused, ekf = (np.array([getattr(s, name) for s in scores]) for name in ("fused", "ekf"))
    inside, ekf_inside, valid = (
        100.0 * np.mean([getattr(s, name) for s in scores]) for name in ("inside", "ekf_inside", "valid")
    )
    run = f"{row.run} (training)" if row.is_training else row.run
    return (
        f"| {row.what} | {run} | {np.median(fused):.2f} / {fused.max():.2f} | {np.median(ekf):.2f} / {ekf.max():.2f} "
        f"| {inside:.0f} % | {ekf_inside:.0f} % | {valid:.0f} % |"
    )


HEADER = """| case | run | product | plain EKF | within 3 sigma | EKF within | model valid |
| --- | --- | --- | --- | --- | --- | --- |"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what every table of this kind takes."""
    parser.add_argument("--only", default="", help="rows whose case or run holds this text")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--signs", type=int, default=len(SIGNS), help="signs of the sensor errors, for a quicker look")


def print_table(rows: Iterable[Row], args: argparse.Namespace) -> None:
    """Print the rows that were asked for; see `add_arguments`."""
    found = [row for row in rows if args.only.lower() in f"{row.what} {row.run}".lower()]
    print(HEADER, flush=True)
    with ProcessPoolExecutor(args.jobs) as pool:
        for row, scores in zip(found, pool.map(judge, found, [args.signs] * len(found)), strict=True):
            print(line(row, scores), flush=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=DATA, help="folder with panasonic-18650pf/ and physics/")
    add_arguments(parser)
    args = parser.parse_args()
    rows: list[Row] = []
    if args.only.lower() in "simulated car from 12 s on":
        rows += car_rows()
    for name, make in (("panasonic-18650pf", panasonic_rows), ("physics", physics_rows)):
        if (args.data / name).is_dir():
            rows += make(args.data / name)
    if rows:
        print_table(rows, args)
    else:
        print(f"skipped: nothing in {args.data}")


if __name__ == "__main__":
    main()
