"""Pictures of docs/contributing/theses.md. matplotlib is imported only when something is drawn."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.balancing_plots import COLOURS, figure_of, save

if TYPE_CHECKING:
    from app.estimation.cell_model.ocv import OcvCurve
    from app.estimation.recording.cell_recording import Recording
    from benchmarks.sources_runs import PatternRun, ThesisRun

FloatArray = NDArray[np.float64]
TRUTH = {"color": "#111111", "linewidth": 1.0, "linestyle": (0, (4, 2))}


def _figure(columns: int, height_in: float = 3.0) -> tuple[Any, Any]:
    figure, axes = figure_of(columns, height_in=height_in)
    for axis in axes:
        axis.set_prop_cycle(color=COLOURS)
    return figure, axes


def draw_thesis(path: Path, redone: ThesisRun, right: PatternRun, curves: Mapping[str, OcvCurve]) -> None:
    """The thesis next to the product: SOC of 96 cells in the hard pattern, and the OCV curve of each."""
    figure, (theirs, ours, ocv) = _figure(3)
    seconds = np.linspace(0.0, 113_605 * 290e-6, redone.truth.size)
    theirs.plot(seconds, 100 * redone.estimate[:, ::8], color=COLOURS[0], alpha=0.25, linewidth=0.5)
    theirs.plot(seconds, 100 * redone.truth, **TRUTH)
    theirs.set(title="thesis: filter, parameters, voltages", xlabel="time [s]", ylabel="SOC [%]")
    ours.plot(right.time_s[::60] / 60.0, 100 * right.estimate[::60, ::8], color=COLOURS[1], alpha=0.4, linewidth=0.5)
    ours.plot(right.time_s[::60] / 60.0, 100 * right.truth[::60].mean(axis=1), **TRUTH)
    ours.set(title="set right, start 50 points off", xlabel="time [min]", ylim=(0, 102))
    soc = np.linspace(0.0, 1.0, 201)
    for name, curve in curves.items():
        ocv.plot(100 * soc, curve.voltage(soc), label=name)
    ocv.set(title="what is taken for the OCV", xlabel="SOC [%]", ylabel="voltage [V]")
    ocv.legend(frameon=False)
    save(figure, path)


def draw_patterns(path: Path, runs: Mapping[str, PatternRun]) -> None:
    """Load, SOC of 12 cells and the driver's number for every pattern."""
    figure, axes = _figure(len(runs), 2.6)
    for axis, (name, run) in zip(axes, runs.items(), strict=True):
        every = max(1, run.time_s.size // 250)
        minutes = run.time_s[::every] / 60.0
        axis.fill_between(minutes, 5 * run.load_c[::every], color="#dddddd", linewidth=0, step="post")
        axis.plot(minutes, 100 * run.estimate[::every], color=COLOURS[0], alpha=0.4, linewidth=0.6)
        axis.plot(minutes, run.driver_percent[::every], color=COLOURS[1])
        axis.plot(minutes, 100 * run.truth[::every].min(axis=1), **TRUTH)
        axis.set(title=name, xlabel="time [min]", ylim=(-55, 102))
    axes[0].set_ylabel("SOC [%]; grey: load [C / 0.2]")
    save(figure, path)


def draw_errors(path: Path, drive: Recording, estimates: Mapping[str, FloatArray]) -> None:
    """SOC and error of some filters on the measured drive."""
    figure, (level, error) = _figure(2)
    elapsed = drive.time_s - drive.time_s[0]
    shown = np.unique(np.geomspace(1, elapsed.size, 2000).astype(int)) - 1
    for name, soc in estimates.items():
        level.plot(elapsed[::40] / 60.0, 100 * soc[::40], label=name)
        error.plot(np.maximum(elapsed, 0.05)[shown], 100 * (soc - drive.soc)[shown], label=name)
    level.plot(elapsed[::40] / 60.0, 100 * drive.soc[::40], **TRUTH, label="charge counted in the laboratory")
    level.set(title="US06, start SOC 50 %", xlabel="time [min]", ylabel="SOC [%]")
    level.legend(frameon=False)
    error.axhspan(-2, 2, color="#eeeeee")
    error.set(title="error; band of 2 points", xlabel="time [s]", ylabel="points", xscale="log", ylim=(-52, 12))
    save(figure, path)
