"""Pictures of the commands on recordings; needs matplotlib, which is the extra `voltwall[plot]`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from app.estimation.errors import DatasetError
from app.estimation.importer import Recording

if TYPE_CHECKING:
    from app.commands.filter_run import Run
    from app.estimation.identify import Identification

MEASURED = "#8a94a6"
MODEL = "#1f6feb"
REFERENCE = "#202630"
POINTS_LIMIT = 20_000  # more are thinned: they cannot be told apart on paper


def check_picture_name(path: Path) -> None:
    """Raise DatasetError unless a picture can be written there: the extra, the ending, the folder."""
    try:
        from matplotlib.backend_bases import FigureCanvasBase
    except ImportError as exc:
        raise DatasetError(str(path), "drawing needs the extra: pip install voltwall[plot]") from exc
    known = sorted(FigureCanvasBase.get_supported_filetypes())
    if path.suffix.lower().removeprefix(".") not in known:
        raise DatasetError(str(path), f"a picture's name ends in one of .{', .'.join(known)}")
    if not path.parent.is_dir():
        raise DatasetError(str(path), "its folder does not exist")


def _figure(path: Path, rows: int, title: str) -> tuple[Any, Any]:
    check_picture_name(path)
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 2.6 * rows), layout="constrained")
    axes = figure.subplots(rows, 1, squeeze=False)[:, 0]
    for axis in axes:
        axis.spines[["top", "right"]].set_visible(False)
        axis.grid(visible=True, alpha=0.25, linewidth=0.6)
    axes[0].set_title(title, loc="left", fontsize=11)
    return figure, axes


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
    figure.savefig(path, dpi=110)


def draw_identification(path: Path, found: Identification) -> None:
    """Draw OCV, the resistances over SOC at 25 degC, and what is left of the voltage in every recording.

    Raises:
        DatasetError: matplotlib is not installed, or the ending of the name is no picture format.
        OSError: the file cannot be written.
    """
    model = found.model
    figure, axes = _figure(path, 3, f"{model.name}: {model.capacity_ah:.4g} Ah")
    soc = np.linspace(0.0, 1.0, 201)
    axes[0].plot(100.0 * soc, model.ocv.voltage(soc), color=MODEL, linewidth=1.2)
    axes[0].set_ylabel("OCV / V")
    values = model.parameters(soc, 25.0)
    names = ["R0"] + [f"R{k + 1}, {tau:.3g} s" for k, tau in enumerate(found.tau_s)]
    for k, name in enumerate(names):
        ohm = values[0] if k == 0 else values[1 + k]
        axes[1].plot(100.0 * soc, 1e3 * ohm, linewidth=1.2, label=name)
    axes[1].set_ylabel("resistance / mohm")
    axes[1].set_ylim(0.0, 4e3 * float(np.median(values[0])) + 1e-3)
    for part in found.parts:
        pick = slice(None, None, -(-part.rows // POINTS_LIMIT))
        label = f"{part.name}: {1e3 * part.voltage_rms_v:.1f} mV RMS"
        axes[2].plot(100.0 * part.soc[pick], 1e3 * part.residual_v[pick], ".", markersize=1.5, label=label)
    limit = 5e3 * max(model.fit_voltage_rms_v, 1e-3)
    axes[2].set_ylim(-limit, limit)
    axes[2].set_ylabel("residual / mV")
    axes[2].set_xlabel("SOC / %")
    for axis in axes[1:]:
        axis.legend(loc="upper right", frameon=False, fontsize=8)
    figure.savefig(path, dpi=110)
