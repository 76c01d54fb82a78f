"""Pictures of the commands on recordings; needs matplotlib, which is the extra `voltwall[plot]`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from app.estimation.importer import DatasetError, Recording

if TYPE_CHECKING:
    from app.commands.estimate import Run

MEASURED = "#8a94a6"
MODEL = "#1f6feb"
REFERENCE = "#202630"
POINTS_LIMIT = 20_000  # more are thinned: they cannot be told apart on paper


def _figure(path: Path, rows: int, title: str) -> tuple[Any, Any]:
    try:
        from matplotlib.figure import Figure
    except ImportError as exc:
        raise DatasetError(str(path), "drawing needs the extra: pip install voltwall[plot]") from exc
    figure = Figure(figsize=(10, 2.6 * rows), layout="constrained")
    axes = figure.subplots(rows, 1, squeeze=False)[:, 0]
    for axis in axes:
        axis.spines[["top", "right"]].set_visible(False)
        axis.grid(visible=True, alpha=0.25, linewidth=0.6)
    axes[0].set_title(title, loc="left", fontsize=11)
    return figure, axes


def _save(figure: Any, path: Path) -> None:
    try:
        figure.savefig(path, dpi=110)
    except ValueError as exc:
        raise DatasetError(str(path), str(exc)) from exc


def draw_estimate(path: Path, recording: Recording, run: Run) -> None:
    """Draw SOC with its 3 sigma band and the reference, voltage measured and predicted, and the residual.

    Raises:
        DatasetError: matplotlib is not installed, or the ending of the name is no picture format.
        OSError: the file cannot be written.
    """
    figure, axes = _figure(path, 3, f"{recording.source}: estimate")
    pick = slice(None, None, -(-len(recording.time_s) // POINTS_LIMIT))
    minutes = (recording.time_s[pick] - recording.time_s[0]) / 60.0
    soc, band = 100.0 * run.soc[pick], 300.0 * run.soc_sigma[pick]
    axes[0].fill_between(minutes, soc - band, soc + band, color=MODEL, alpha=0.18, linewidth=0, label="3 sigma")
    axes[0].plot(minutes, soc, color=MODEL, linewidth=1.2, label="estimate")
    if np.isfinite(recording.soc).any():
        axes[0].plot(minutes, 100.0 * recording.soc[pick], color=REFERENCE, linewidth=1.0, label="reference")
    axes[0].set_ylabel("SOC / %")
    axes[0].set_ylim(max(-5.0, np.nanmin(soc) - 10.0), min(105.0, np.nanmax(soc) + 10.0))
    axes[1].plot(minutes, recording.voltage_v[pick], color=MEASURED, linewidth=0.8, label="measured")
    axes[1].plot(minutes, run.voltage_v[pick], color=MODEL, linewidth=0.8, label="predicted")
    axes[1].set_ylabel("voltage / V")
    residual, sigma = 1e3 * run.innovation_v[pick], 3e3 * run.innovation_sigma_v[pick]
    axes[2].fill_between(minutes, -sigma, sigma, color=MODEL, alpha=0.18, linewidth=0, label="3 sigma expected")
    axes[2].plot(minutes, residual, color=MEASURED, linewidth=0.6, label="measured - predicted")
    axes[2].set_ylabel("residual / mV")
    axes[2].set_xlabel("time / min")
    for axis in axes:
        axis.legend(loc="upper right", frameon=False, fontsize=8, ncols=3)
    _save(figure, path)
