"""Rows of SOC: drives of shared data, each with a model that was identified without it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from app.commands.filter_run import run_filter
from app.estimation.cell_model.circuit import CellModel
from app.estimation.errors import EstimatorError
from app.estimation.filters.estimators import make_estimator
from app.estimation.identification.identify import identify
from app.estimation.recording.cell_recording import Recording, believable
from app.sources.recordings.dataset import load_recording
from benchmarks import plain_ekf
from tests.numeric.judgement import SIGNS, disturbed, rmse_points, rows_of

FloatArray = NDArray[np.float64]

PANASONIC, PHYSICS = "panasonic-18650pf", "physics"
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
    """The names of the recordings, in a folder of the shared data, that a model is identified from."""

    folder: str
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
        drive: name of the recording, in the folder of `tests`.
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
    """What came of a row, (m,) over its starts and the signs of the sensor errors; RMSE in points of SOC."""

    rmse: FloatArray
    ekf: FloatArray
    inside_3_sigma: FloatArray
    valid: FloatArray


def panasonic(drives: tuple[str, ...], temperatures: tuple[str, ...] = TEMPERATURES) -> Tests:
    """Return the tests of the Panasonic cell at some temperatures, with some of its drives."""
    pulses = tuple(f"{name}_{at}" for at in temperatures for name in ("hppc5pulse", "hppc_interpulse_discharge"))
    return Tests(PANASONIC, ("c20_ocv_25degC",), pulses, drives)


def physics(cell: str, *drives: str) -> Tests:
    """Return the tests of a cell of PyBaMM."""
    pulses = (f"{cell}_hppc",) if cell == "Prada2013" else (f"{cell}_hppc", f"{cell}_hppc40")
    return Tests(PHYSICS, (f"{cell}_c30",), pulses, drives)


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
        yield Row("10 low", drive, panasonic(PANASONIC_DRIVES), goal + 0.3 * (drive == COLD), LOW)
    for cell in PHYSICS_CELLS:
        yield Row("right start", f"{cell}_train", physics(cell, f"{cell}_train"), 0.4)


def held_out_rows() -> Iterator[Row]:
    """Yield the rows of drives that took no part in the identification."""
    for drive in PANASONIC_DRIVES[:3]:
        yield Row("right start", drive, without(drive), 0.35)
        yield Row("10 low", drive, without(drive), 0.35, LOW)
    yield Row("right start", COLD, without(COLD), 1.0)
    yield Row("10 low", COLD, without(COLD), 1.3, LOW)
    warm = panasonic(PANASONIC_DRIVES[:2], TEMPERATURES[:1])
    yield Row("model of 25 degC alone, right start", COLD, warm, 1.0)
    yield Row("model of 25 degC alone, 10 low", COLD, warm, 1.5, LOW)
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
        Tests(PANASONIC, (name,), ("hppc5pulse_25degC", "hppc_interpulse_discharge_25degC"), has_soc=False)
        for name in ("dis1C_start_25degC", "c20_ocv_25degC")
    )
    for drive in PANASONIC_DRIVES[:2]:
        yield Row("1C discharge and HPPC, no soc column", drive, loaded, 2.0)
    for drive in PANASONIC_DRIVES[:2]:
        yield Row("C/20 and HPPC, no soc column", drive, slow, 0.7)


@cache
def recording(path: Path) -> Recording:
    """Return a recording, read once."""
    return load_recording(path)


@cache
def model_of(tests: Tests, data: Path) -> CellModel:
    """Return what `voltwall identify` makes of tests.

    Raises:
        EstimatorError: it refuses them.
    """

    def read(names: Sequence[str]) -> list[Recording]:
        found = [recording(data / tests.folder / f"{name}.csv.gz") for name in names]
        return found if tests.has_soc else [replace(r, soc=np.full_like(r.soc, np.nan)) for r in found]

    return identify(read(tests.slow), read(tests.pulses), read(tests.drives)).model


def judge(row: Row, data: Path) -> Found | str:
    """Return what came of a row, or why `identify` refused its tests."""
    try:
        model = model_of(row.tests, data)
    except EstimatorError as error:
        return str(error)
    model = replace(model, capacity_ah=row.capacity * model.capacity_ah)
    found = []
    for drive in row.change(recording(data / row.tests.folder / f"{row.drive}.csv.gz")):
        for off in row.starts:
            first = float(drive.soc[0])
            soc = None if off is None else min(max(first + off, 0.0), 1.0)
            for gain, offset in SIGNS:
                voltage, current = disturbed(drive, model.capacity_ah / row.capacity, gain, offset)
                sensed = believable(replace(drive, voltage_v=voltage, current_a=current), model.capacity_ah)
                run = run_filter(make_estimator("fused", model, 1), sensed, model.capacity_ah, soc, None, model)
                error = run.soc - drive.soc
                inside = float(np.mean(np.abs(error) <= 3.0 * run.soc_sigma))
                ekf = rmse_points(plain_ekf.run(model, sensed, soc), drive.soc)
                found.append((rmse_points(run.soc, drive.soc), ekf, inside, run.model_valid_frac))
    return Found(*np.array(found).T)


HEADER: Final = """| case | drive | goal | RMSE | EKF | within 3 sigma | model valid |
| --- | --- | --- | --- | --- | --- | --- |"""


def line(row: Row, found: Found | str) -> str:
    """Return a row of Markdown."""
    name = row.drive.replace("_", " ").replace("degC", " degC")
    if isinstance(found, str):
        return f"| {row.case} | {name} | {row.goal:.2g} | refused | | | |"
    rmse, ekf = found.rmse, found.ekf
    return (
        f"| {row.case} | {name} | {row.goal:.2g} | {np.median(rmse):.2f} / {rmse.max():.2f} | {np.median(ekf):.2f} / "
        f"{ekf.max():.2f} | {100.0 * found.inside_3_sigma.mean():.1f} % | {100.0 * found.valid.mean():.0f} % |"
    )
