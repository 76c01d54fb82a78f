"""The voltage of measured and PyBaMM drives, foretold 10 s ahead under the current that then really flowed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import inf
from pathlib import Path

import numpy as np

from app.commands.filter_run import run_filter
from app.estimation.cell_model.circuit import CellModel
from app.estimation.filters.estimators import make_estimator
from app.estimation.identification.identify import identify
from app.estimation.prediction.calibration import AHEAD_S, LOADED_C
from app.estimation.prediction.constant_current import OperatingPoint
from app.estimation.prediction.power_along import branch_currents, voltage_ahead
from app.estimation.recording.cell_recording import FIELDS, Recording
from app.sources.recordings.dataset import load_recording

SETTLED_S = 60.0  # the filter has started
TRAINING = "(training)"
PANASONIC = "panasonic-18650pf"


def models(data: Path) -> Iterator[tuple[str, CellModel, Recording]]:
    """Yield name, cell identified without the drive, and drive; those marked "training" took part in tuning."""
    folder = data / PANASONIC
    if folder.is_dir():

        def read(name: str, temperature: str = "25degC") -> Recording:
            return load_recording(folder / f"{name}_{temperature}.csv.gz")

        model = identify([read("c20_ocv")], [read("hppc5pulse")], [], 2, "Panasonic").model
        yield "Panasonic US06, from pulses", model, read("us06")
        yield f"Panasonic Cycle 1, from pulses {TRAINING}", model, read("cycle1")
        yield "Panasonic Cycle 1 at 10 degC, from 25 degC", model, read("cycle1", "10degC")
        yield "Panasonic Cycle 1 at 0 degC, from 25 degC", model, read("cycle1", "0degC")
    folder = data / "physics"
    for cell in ("Mohtat2020", "Chen2020", "Prada2013") if folder.is_dir() else ():
        slow, pulses, train = (load_recording(folder / f"{cell}_{name}.csv.gz") for name in ("c30", "hppc", "train"))
        name = f"{cell}, from pulses" + (f" {TRAINING}" if cell == "Chen2020" else "")
        yield name, identify([slow], [pulses], [], 2, cell).model, train


def first_seconds(drive: Recording, seconds: float) -> Recording:
    """Return the beginning of a drive."""
    rows = drive.time_s <= drive.time_s[0] + seconds
    return replace(drive, **{name: getattr(drive, name)[rows] for name in FIELDS})


def score(cell: CellModel, drive: Recording) -> tuple[int, float, float, float, float]:
    """Return rows judged, share in the band, median and RMS error [V], and half the band [V]."""
    result = run_filter(make_estimator("fused", cell, 1), drive, cell.capacity_ah)
    degc = np.where(np.isnan(drive.temperature_degc), 25.0, drive.temperature_degc)
    branches = branch_currents(cell, drive.step_s, drive.current_a, result.soc, degc)
    states = OperatingPoint(result.soc, branches, degc)
    foretold = voltage_ahead(cell, drive.time_s, drive.current_a, drive.voltage_v, states, result.soc_sigma, AHEAD_S)
    off_v, half_v = drive.voltage_v - foretold.voltage_v, foretold.half_band_v
    rows = np.isfinite(off_v) & (drive.time_s - drive.time_s[0] > SETTLED_S)
    rows &= np.abs(drive.current_a) > LOADED_C * cell.capacity_ah
    error_v, inside = np.abs(off_v[rows]), np.abs(off_v[rows]) <= half_v[rows]
    rms_v, half = float(np.sqrt(np.mean(error_v**2))), float(np.median(half_v[rows]))
    return int(rows.sum()), float(inside.mean()), float(np.median(error_v)), rms_v, half


def drive_scores(
    data: Path, seconds: float = inf, *, with_training: bool = True
) -> Iterator[tuple[str, tuple[int, float, float, float, float]]]:
    """Yield the name of each drive and its `score`, of the first seconds alone or of all."""
    for name, cell, drive in models(data):
        if with_training or TRAINING not in name:
            yield name, score(cell, first_seconds(drive, seconds))
