"""Pictures of the commands; needs matplotlib, which is the extra `voltwall[plot]`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.errors import DatasetError
from app.estimation.recording.cell_recording import Recording

if TYPE_CHECKING:
    from app.commands.filter_run import Run
    from app.estimation.identification.identify import Identification

MEASURED = "#8a94a6"
MODEL = "#1f6feb"
REFERENCE = "#202630"
SHADES = ("#1f6feb", "#d9730d", "#2a9d6f", "#a23b8f")
DROP_S = (0.0, 10.0, 300.0)  # after which a drop is drawn
POINTS_LIMIT = 20_000  # points of a curve; more are thinned: paper cannot show them


def check_picture_name(path: Path) -> None:
    """Raise DatasetError unless a picture can be written there: the extra, the ending, the folder."""
    try:
        from matplotlib.backend_bases import FigureCanvasBase
    except ImportError as exc:
        raise DatasetError(str(path), "drawing needs the extra: pip install voltwall[plot]") from exc
    formats = sorted(FigureCanvasBase.get_supported_filetypes())
    if path.suffix.lower().removeprefix(".") not in formats:
        raise DatasetError(str(path), f"a picture's name ends in one of .{', .'.join(formats)}")
    if not path.parent.is_dir():
        raise DatasetError(str(path), "its folder does not exist")


def new_figure(path: Path, rows: int, title: str, subtitle: str) -> tuple[Any, Any]:
    """Return a figure and its rows of axes, which share the horizontal one; DatasetError as `check_picture_name`."""
    check_picture_name(path)
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 2.3 * rows + 0.6), layout="constrained")
    axes = figure.subplots(rows, 1, squeeze=False, sharex=True)[:, 0]
    for axis in axes:
        axis.spines[["top", "right"]].set_visible(False)
        axis.grid(visible=True, alpha=0.25, linewidth=0.6)
    figure.suptitle(title, x=0.01, ha="left", fontsize=12, fontweight="bold")
    axes[0].set_title(subtitle, loc="left", fontsize=9, color=MEASURED)
    return figure, axes


def put_legends(axes: Any) -> None:
    """Put every panel's legend above its right end, where it covers nothing, in lines of full strength."""
    for axis in axes:
        if axis.get_legend_handles_labels()[1]:
            place = {"loc": "lower right", "bbox_to_anchor": (1.0, 0.98), "borderaxespad": 0.0}
            axis.legend(**place, frameon=False, fontsize=8, ncols=4, handlelength=1.4, markerscale=5.0)


def draw_estimate(path: Path, recording: Recording, run: Run) -> None:
    """Draw SOC with its 3 sigma band and the reference, its error where that is known, voltage and residual.

    Raises:
        DatasetError: matplotlib is not installed, or the ending of the name is no picture format.
        OSError: the file cannot be written.
    """
    is_scored = bool(np.isfinite(recording.soc).any())
    hours = (recording.time_s[-1] - recording.time_s[0]) / 3600.0
    subtitle = (
        f"{len(recording.time_s):,} rows, {60.0 * hours:.0f} min, {np.abs(recording.current_a).max():.3g} A at most"
    )
    figure, axes = new_figure(path, 4 if is_scored else 3, f"{recording.source}: estimate", subtitle)
    pick = slice(None, None, -(-len(recording.time_s) // POINTS_LIMIT))
    minutes = (recording.time_s[pick] - recording.time_s[0]) / 60.0
    soc, band = 100.0 * run.soc[pick], 300.0 * run.soc_sigma[pick]
    axes[0].fill_between(minutes, soc - band, soc + band, color=MODEL, alpha=0.18, linewidth=0, label="3 sigma")
    axes[0].plot(minutes, soc, color=MODEL, linewidth=1.4, label="estimate")
    axes[0].set_ylabel("SOC / %")
    axes[0].set_ylim(max(-5.0, np.nanmin(soc) - 10.0), min(105.0, np.nanmax(soc) + 10.0))
    if is_scored:
        reference = 100.0 * recording.soc[pick]
        axes[0].plot(minutes, reference, color=REFERENCE, linewidth=0.9, linestyle=(0, (4, 2)), label="reference")
        axes[1].fill_between(minutes, -band, band, color=MODEL, alpha=0.18, linewidth=0, label="3 sigma")
        axes[1].plot(minutes, soc - reference, color=MODEL, linewidth=1.0, label="estimate - reference")
        axes[1].set_ylabel("error / points")
        axes[1].set_ylim(*_shown(soc - reference, max(1.0, 1.3 * float(np.nanmedian(band)))))
    voltage, residual_axis = axes[-2], axes[-1]
    voltage.plot(minutes, recording.voltage_v[pick], color=MEASURED, alpha=0.6, linewidth=1.8, label="measured")
    voltage.plot(minutes, run.voltage_v[pick], color=MODEL, linewidth=0.6, label="predicted")
    voltage.set_ylabel("voltage / V")
    residual, sigma = 1e3 * run.innovation_v[pick], 3e3 * run.innovation_sigma_v[pick]
    residual_axis.fill_between(minutes, -sigma, sigma, color=MODEL, alpha=0.18, linewidth=0, label="3 sigma expected")
    residual_axis.plot(minutes, residual, color=REFERENCE, linewidth=0.6, label="measured - predicted")
    residual_axis.set_ylabel("residual / mV")
    residual_axis.set_ylim(*_shown(residual, 20.0))
    residual_axis.set_xlabel("time / min")
    axes[0].set_xlim(0.0, float(minutes[-1]))
    put_legends(axes)
    figure.savefig(path, dpi=110)


def draw_identification(path: Path, identification: Identification) -> None:
    """Draw OCV, the drop at 1C over SOC at 25 degC, and what is left of the voltage in every recording.

    Raises:
        DatasetError: matplotlib is not installed, or the ending of the name is no picture format.
        OSError: the file cannot be written.
    """
    model = identification.model
    subtitle = f"{model.capacity_ah:.4g} Ah, {model.n_rc} lags; open loop {1e3 * model.fit_voltage_rms_v:.1f} mV RMS"
    subtitle += f", up to {model.fit_current_max_a:.3g} A"
    figure, axes = new_figure(path, 2 + len(identification.parts), model.name, subtitle)
    soc = np.linspace(0.0, 1.0, 201)
    axes[0].plot(100.0 * soc, model.ocv.voltage(soc), color=MODEL, linewidth=1.4)
    axes[0].set_ylabel("OCV / V")
    amps = model.c_rate_a
    for k, seconds in enumerate(DROP_S):
        branch_a = amps * (1.0 - np.exp(-seconds / model.time_constants(soc, 25.0)))
        drop_v = model.drop_v(soc, branch_a, amps, 25.0)
        axes[1].plot(100.0 * soc, 1e3 * drop_v, color=SHADES[k], linewidth=1.4, label=f"1C for {seconds:g} s, 25 degC")
    axes[1].set_ylabel("drop / mV")
    axes[1].set_ylim(0.0, 4e3 * float(np.median(drop_v)) + 1e-3)
    limit = 5e3 * max(model.fit_voltage_rms_v, 1e-3)
    for axis, part in zip(axes[2:], identification.parts, strict=True):
        pick = slice(None, None, -(-part.rows // POINTS_LIMIT))
        label = f"{part.name}: {1e3 * part.voltage_rms_v:.1f} mV RMS, up to {part.current_max_a:.3g} A"
        axis.plot(
            100.0 * part.soc[pick],
            1e3 * part.residual_v[pick],
            ".",
            color=MODEL,
            alpha=0.5,
            markersize=1.5,
            label=label,
        )
        axis.axhline(0.0, color=REFERENCE, linewidth=0.6)
        axis.set_ylim(-limit, limit)
        axis.set_ylabel("residual / mV")
    axes[-1].set_xlabel("SOC / %")
    axes[0].set_xlim(-2.0, 102.0)
    put_legends(axes)
    figure.savefig(path, dpi=110)


def _shown(values: FloatArray, least: float) -> tuple[float, float]:
    """Return symmetric limits that show all but the rarest values."""
    finite = np.abs(values[np.isfinite(values)])
    reach = max(1.3 * float(np.percentile(finite, 99.8)), least) if finite.size else least
    return -reach, reach
