"""Rows of SOC: drives of shared data, each with a model that was identified without it."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.commands.arguments import add_reading_arguments, read_recording
from app.commands.filter_run import run_filter
from app.estimation.cell_model.circuit import CellModel
from app.estimation.errors import EstimatorError
from app.estimation.filters.estimators import make_estimator
from app.estimation.identification.identify import identify, open_loop_voltage
from app.estimation.identification.parts import Part
from app.estimation.recording.cell_recording import Recording, believable
from app.sources.recordings.dataset import load_recording
from benchmarks import plain_ekf
from benchmarks.pybamm_recordings import OWN
from tests.numeric.judgement import SIGNS, disturbed, rmse_points, rows_of
from tests.numeric.pybamm_cells import save

FloatArray = NDArray[np.float64]

Folders = tuple[Path, ...]  # recordings are looked for in the first, then in the next

SHARED: Final = ("panasonic-18650pf", "physics")  # folders of the shared data
TEMPERATURES: Final = ("25degC", "10degC", "0degC", "n10degC")
PANASONIC_DRIVES: Final = ("us06_25degC", "cycle1_25degC", "cycle1_10degC", "cycle1_0degC")
PHYSICS_CELLS: Final = ("Prada2013", "Chen2020", "Mohtat2020")
DRIVES: Final = (*PANASONIC_DRIVES, *(f"{cell}_train" for cell in PHYSICS_CELLS))
COLD: Final = PANASONIC_DRIVES[3]
LOW, OFF, FAR_OFF, UNKNOWN = (-0.1,), (-0.05, 0.05), (-0.1, 0.1), (None,)  # starts
WAKES_SOC: Final = (0.75, 0.65, 0.4)  # where a filter wakes up that knows no SOC
AGED: Final = 1.11
LOADED_C: Final = 0.1


@dataclass(frozen=True)
class Tests:
    """The names of the recordings that a model is identified from."""

    slow: tuple[str, ...]
    pulses: tuple[str, ...]
    drives: tuple[str, ...] = ()
    has_soc: bool = True  # False: without their soc columns, as most teams have them


def as_recorded(drive: Recording) -> list[Recording]:
    """Return the drive."""
    return [drive]


def woken(drive: Recording) -> list[Recording]:
    """Return what is left of a drive where its SOC has come to each of `WAKES_SOC`."""
    ends = [int(np.argmax(drive.soc <= soc)) for soc in WAKES_SOC if drive.soc[0] > soc > drive.soc[-1]]
    return [rows_of(drive, np.arange(drive.time_s.size) >= k) for k in ends]


def driven_off(drive: Recording) -> list[Recording]:
    """Return the drive without the rest that it begins with."""
    loaded = np.abs(drive.current_a) > LOADED_C * np.ptp(drive.charge_ah)
    return [rows_of(drive, np.arange(drive.time_s.size) >= int(loaded.argmax()))]


def averaged(drive: Recording) -> list[Recording]:
    """Return a row a second: the current's mean over it, everything else as at its end, as many loggers write."""
    second = np.floor(drive.time_s - drive.time_s[0]).astype(np.intp)
    last = np.flatnonzero(np.diff(second, append=second[-1] + 1))
    mean = np.bincount(second, drive.current_a) / np.maximum(np.bincount(second), 1)
    return [replace(rows_of(drive, np.isin(np.arange(second.size), last)), current_a=mean[second[last]])]


@dataclass(frozen=True)
class Row:
    """A row of the table: a drive, its model, and starts.

    Attributes:
        case: what is tried.
        drive: name of the recording.
        tests: what the model is identified from.
        goal: of the median RMSE [points].
        starts: SOC off by so much; None = unknown.
        change: what is done to the drive first; one drive may become several.
        capacity: of the cell file over the identified one.
    """

    case: str
    drive: str
    tests: Tests
    goal: float
    starts: tuple[float | None, ...] = (0.0,)
    change: Callable[[Recording], Sequence[Recording]] = as_recorded
    capacity: float = 1.0


@dataclass(frozen=True)
class Found:
    """Results of a row, (m,) over its starts and the signs of the sensor errors; RMSE in points of SOC."""

    rmse: FloatArray
    ekf: FloatArray
    inside_3_sigma: FloatArray
    valid: FloatArray


def as_read(written: Recording) -> Recording:
    """Return what `voltwall estimate` reads of a recording that a logger wrote."""
    parser = argparse.ArgumentParser()
    add_reading_arguments(parser)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "drive.csv"
        save(written, path)
        return read_recording(path, parser.parse_args([]))


def panasonic(drives: tuple[str, ...], temperatures: tuple[str, ...] = TEMPERATURES) -> Tests:
    """Return the tests of the Panasonic cell at some temperatures, with some of its drives."""
    pulses = tuple(f"{name}_{at}" for at in temperatures for name in ("hppc5pulse", "hppc_interpulse_discharge"))
    return Tests(("c20_ocv_25degC",), pulses, drives)


WARM: Final = panasonic(PANASONIC_DRIVES[:2], TEMPERATURES[:1])


def physics(cell: str, *drives: str) -> Tests:
    """Return the tests of a cell of PyBaMM."""
    pulses = (f"{cell}_hppc",) if cell == "Prada2013" else (f"{cell}_hppc", f"{cell}_hppc40")
    return Tests((f"{cell}_c30",), pulses, drives)


def without(drive: str) -> Tests:
    """Return all tests and drives of a cell but this drive."""
    if drive in PANASONIC_DRIVES:
        return panasonic(tuple(name for name in PANASONIC_DRIVES if name != drive))
    return physics(drive.partition("_")[0])


def training_rows() -> Iterator[Row]:
    """Yield the rows of drives that took part in the identification."""
    for drive in PANASONIC_DRIVES:
        goal = 1.0 if drive == COLD else 0.35
        yield Row("right start", drive, panasonic(PANASONIC_DRIVES), goal)
        yield Row("10 low", drive, panasonic(PANASONIC_DRIVES), 1.3 if drive == COLD else 0.35, LOW)
    for cell in PHYSICS_CELLS:
        yield Row("right start", f"{cell}_train", physics(cell, f"{cell}_train"), 0.4)


def held_out_rows() -> Iterator[Row]:
    """Yield the rows of drives that took no part in the identification."""
    for drive in PANASONIC_DRIVES[:3]:
        yield Row("right start", drive, without(drive), 0.35)
        yield Row("10 low", drive, without(drive), 0.35, LOW)
    yield Row("right start", COLD, without(COLD), 1.0)
    yield Row("10 low", COLD, without(COLD), 1.3, LOW)
    yield Row("model of 25 degC alone, right start", COLD, WARM, 1.0)
    yield Row("model of 25 degC alone, 10 low", COLD, WARM, 1.5, LOW)
    lfp, hard, race = (f"{cell}_train" for cell in PHYSICS_CELLS)
    yield Row("LFP, right start", lfp, without(lfp), 0.5)
    yield Row("LFP, 5 low", lfp, without(lfp), 1.0, (-0.05,))
    yield Row("LFP, unknown", lfp, without(lfp), 1.5, UNKNOWN)
    yield Row("5C, pulses of 3C, right start", hard, without(hard), 0.5)
    yield Row("5C, pulses of 3C, 5 off", hard, without(hard), 0.7, OFF)
    yield Row("8C race, right start", race, without(race), 0.4)
    yield Row("8C race, 5 off", race, without(race), 0.6, OFF)
    for drive in (hard, race):
        yield Row("driven off at once, 10 off", drive, without(drive), 1.4, FAR_OFF, driven_off)
    for drive in DRIVES:
        yield Row("unknown in mid-drive", drive, without(drive), 4.0, UNKNOWN, woken)
    for drive in DRIVES:
        yield Row("capacity 11 % too large", drive, without(drive), 1.3, capacity=AGED)
    for drive in DRIVES:
        yield Row("means of a second", drive, without(drive), 0.5, change=averaged)
    loaded, slow = (
        Tests((name,), ("hppc5pulse_25degC", "hppc_interpulse_discharge_25degC"), has_soc=False)
        for name in ("dis1C_start_25degC", "c20_ocv_25degC")
    )
    for drive in PANASONIC_DRIVES[:2]:
        yield Row("1C discharge and HPPC, no soc column", drive, loaded, 2.0)
    for drive in PANASONIC_DRIVES[:2]:
        yield Row("C/20 and HPPC, no soc column", drive, slow, 0.7)


def race_rows() -> Iterator[Row]:
    """Yield the rows of second races of simulated cells, with a model from their tests and the first race."""
    for cell in OWN:
        drive, tests = f"{cell}_race", physics(cell, f"{cell}_train")
        yield Row("right start", drive, tests, 0.4)
        yield Row("5 off", drive, tests, 0.6, OFF)
        yield Row("driven off at once, 10 off", drive, tests, 1.4, FAR_OFF, driven_off)
        yield Row("unknown in mid-drive", drive, tests, 4.0, UNKNOWN, woken)
        yield Row("means of a second", drive, tests, 0.5, change=averaged)
        yield Row("model of pulses alone, right start", drive, physics(cell), 0.5)
        yield Row("model of pulses alone, 5 off", drive, physics(cell), 0.7, OFF)


@cache
def recording(name: str, folders: Folders) -> Recording:
    """Return a recording, read once.

    Raises:
        DatasetError: it is in none of the folders.
    """
    paths = [folder / f"{name}.csv.gz" for folder in folders]
    return load_recording(next((path for path in paths if path.is_file()), paths[0]))


@cache
def model_of(tests: Tests, folders: Folders) -> CellModel:
    """Return what `voltwall identify` makes of tests.

    Raises:
        EstimatorError: it refuses them.
    """

    def read(names: Sequence[str]) -> list[Recording]:
        recordings = [recording(name, folders) for name in names]
        return recordings if tests.has_soc else [replace(r, soc=np.full_like(r.soc, np.nan)) for r in recordings]

    return identify(read(tests.slow), read(tests.pulses), read(tests.drives)).model


def judge(row: Row, folders: Folders) -> Found | str:
    """Return what came of a row, or why `identify` refused its tests."""
    try:
        model = model_of(row.tests, folders)
    except EstimatorError as error:
        return str(error)
    model = replace(model, capacity_ah=row.capacity * model.capacity_ah)
    estimates = []
    for drive in row.change(recording(row.drive, folders)):
        for off in row.starts:
            first = float(drive.soc[0])
            soc = None if off is None else min(max(first + off, 0.0), 1.0)
            for gain, offset in SIGNS:
                voltage, current = disturbed(drive, model.capacity_ah / row.capacity, gain, offset)
                measured = replace(drive, voltage_v=voltage, current_a=current)
                sensed = believable(as_read(measured) if row.change is averaged else measured, model.capacity_ah)
                run = run_filter(make_estimator("fused", model, 1), sensed, model.capacity_ah, soc, None, model)
                off_by = run.soc - sensed.soc
                inside = float(np.mean(np.abs(off_by) <= 3.0 * run.soc_sigma))
                ekf = rmse_points(plain_ekf.run(model, measured, soc), drive.soc)
                estimates.append((rmse_points(run.soc, sensed.soc), ekf, inside, run.model_valid_frac))
    return Found(*np.array(estimates).T)


HEADER: Final = """| case | drive | goal | RMSE | EKF | within 3 sigma | model valid |
| --- | --- | --- | --- | --- | --- | --- |"""


def first_of(row: Row) -> str:
    """Return the beginning of a row of Markdown."""
    return f"| {row.case} | {_named(row.drive)} | {row.goal:g} |"


def _named(drive: str) -> str:
    return drive.replace("_", " ").replace("degC", " degC")


def first_of_rows(rows: Callable[[], Iterator[Row]]) -> list[str]:
    """Return the beginnings of all rows."""
    return [first_of(row) for row in rows()]


def line(row: Row, result: Found | str) -> str:
    """Return a row of Markdown."""
    if isinstance(result, str):
        return f"{first_of(row)} refused | | | |"
    rmse, ekf = result.rmse, result.ekf
    return (
        f"{first_of(row)} {np.median(rmse):.2f}/{rmse.max():.2f} | {np.median(ekf):.2f}/{ekf.max():.2f} | "
        f"{100.0 * result.inside_3_sigma.mean():.1f} % | {100.0 * result.valid.mean():.0f} % |"
    )


VOLTAGE_HEADER: Final = """| drive | model from | RMS | mean of each sixth |
| --- | --- | --- | --- |"""


def voltage_rows() -> list[tuple[str, str, Tests]]:
    """Return the drives whose voltage is foretold with the true SOC, what the model is from, and its tests."""
    rows = [(drive, "all but this drive", without(drive)) for drive in DRIVES]
    return [*rows, *((drive, "25 degC alone", WARM) for drive in PANASONIC_DRIVES[2:])]


def voltage_first_of(drive: str, source: str) -> str:
    """Return the beginning of a row of Markdown."""
    return f"| {_named(drive)} | {source} |"


def voltage_line(drive: str, source: str, tests: Tests, folders: Folders) -> str:
    """Return a row of Markdown: measured minus modelled voltage, open loop."""
    whole = recording(drive, folders)
    off_mv = 1e3 * (whole.voltage_v - open_loop_voltage(model_of(tests, folders), Part(whole, whole.soc, True)))
    sixths = " ".join(f"{np.nanmean(part):.0f}" for part in np.array_split(off_mv, 6))
    return f"{voltage_first_of(drive, source)} {np.sqrt(np.nanmean(off_mv**2)):.0f} mV | {sixths} mV |"
