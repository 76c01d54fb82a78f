"""`voltwall identify`: fit a cell model to measurements, write it as a cell file, say how well it fits."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np

from app.commands.cell_commands.charts import check_picture_name, draw_identification
from app.commands.cell_commands.recordings import read_recording
from app.commands.console.progress import Progress, leave_no_line
from app.estimation.cell_model.cell_file import save_cell
from app.estimation.errors import DatasetError, EstimatorError
from app.estimation.identification.identify import Identification, identify


def run(args: argparse.Namespace) -> int:
    """Run the command; 0 when the cell file is written, 2 when the files cannot be used."""
    try:
        if args.plot is not None:
            check_picture_name(args.plot)
        slow, pulses, drives = (
            [read_recording(path, args) for path in paths] for paths in (args.ocv, args.pulses, args.drive)
        )
        progress = Progress(args.out.stem)
        found = identify(slow, pulses, drives, args.rc, args.name or args.out.stem, progress)
        progress.end()
        save_cell(found.model, args.out)
        if args.plot is not None:
            draw_identification(args.plot, found)
    except (DatasetError, EstimatorError, OSError) as exc:
        leave_no_line()
        print(f"voltwall identify: {exc}", file=sys.stderr)
        return 2
    read_notes = [(r.source, note) for r in (*slow, *pulses, *drives) for note in r.notes]
    if args.json:
        print(json.dumps(_report(found, read_notes, args.out)))
    else:
        _print_report(found, read_notes, args.out)
    return 0


def _report(found: Identification, read_notes: list[tuple[str, str]], out: Path) -> dict[str, object]:
    parts = [{k: v for k, v in vars(part).items() if k not in ("soc", "residual_v")} for part in found.parts]
    for part in parts:
        low, high = part["temperature_range_degc"]
        part["temperature_range_degc"] = None if np.isnan(low) else [low, high]
        if np.isnan(part["voltage_rms_v"]):
            part["voltage_rms_v"] = None
    return {
        "cell": str(out),
        "capacity_ah": found.model.capacity_ah,
        "counted_ah": found.counted_ah,
        "tau_s": list(found.tau_s),
        "activation_j_mol": found.activation_j_mol,
        "fit_voltage_rms_v": found.model.fit_voltage_rms_v,
        "parts": parts,
        "notes": [f"{source}: {note}" for source, note in read_notes] + list(found.notes),
        "warnings": list(found.warnings),
    }


def _print_report(found: Identification, read_notes: list[tuple[str, str]], out: Path) -> None:
    model = found.model
    at = (0.5, 25.0)
    values = model.parameters(*at)
    print(f"{out}: {model.capacity_ah:.4g} Ah, {model.n_rc} RC pairs")
    print(f"  at 50 % and 25 degC: R0 {1e3 * values[0]:.3g} mohm", end="")
    for k, tau in enumerate(found.tau_s):
        print(f", R{k + 1} {1e3 * values[2 + k]:.3g} mohm with {tau:.3g} s", end="")
    print(f", asinh term {1e3 * values[1]:.3g} mV")
    print("  open-loop voltage error")
    for part in found.parts:
        kind = "drive" if part.is_drive else "pulses"
        low, high = (100.0 * soc for soc in part.soc_range)
        print(
            f"    {part.name} ({kind}): {1e3 * part.voltage_rms_v:.1f} mV RMS, up to {part.current_max_a:.3g} A, "
            f"SOC {low:.0f} to {high:.0f} %"
        )
    for source, note in read_notes:
        print(f"  note: {source}: {note}")
    for note in found.notes:
        print(f"  note: {note}")
    for warning in found.warnings:
        print(f"  warning: {warning}")
