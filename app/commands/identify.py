"""`voltwall identify`: fit a cell model to measurements, write it as a cell file, say how well it fits."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from app.commands.arguments import add_reading_arguments, read_recording
from app.commands.console import Progress

if TYPE_CHECKING:
    from app.estimation.cell_model.surface import SurfaceModel
    from app.estimation.identification.identify import Identification


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.set_defaults(run=run)
    parser.description = (
        "Fit OCV, ohmic drop, kinetics and diffusion of a cell to slow tests, pulse tests and, better, a drive."
    )
    parser.add_argument(
        "--ocv", nargs="+", required=True, type=Path, metavar="FILE", help="slow discharge and charge, C/10 or less"
    )
    parser.add_argument(
        "--pulses", nargs="+", default=[], type=Path, metavar="FILE", help="pulse tests, at one or more temperatures"
    )
    parser.add_argument(
        "--drive", nargs="+", default=[], type=Path, metavar="FILE", help="drives with the currents of a race"
    )
    parser.add_argument(
        "--rc",
        type=int,
        default=2,
        choices=range(5),
        metavar="N",
        help="first-order lags of the current, 0..4 (default 2)",
    )
    parser.add_argument("--out", required=True, type=Path, metavar="CELL.toml", help="the cell file to write")
    parser.add_argument("--name", help="name of the cell (default: name of the cell file)")
    parser.add_argument("--json", action="store_true", help="print the report as JSON")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw OCV, resistances and the residual of each file")
    add_reading_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Run the command.

    Raises:
        EstimatorError: the files cannot be used.
    """
    from app.commands.cell_charts import check_picture_name, draw_identification
    from app.estimation.cell_model.cell_file import save_cell
    from app.estimation.identification.identify import identify

    if args.plot is not None:
        check_picture_name(args.plot)
    slow, pulses, drives = (
        [read_recording(path, args) for path in paths] for paths in (args.ocv, args.pulses, args.drive)
    )
    with Progress(args.out.stem) as progress:
        identification = identify(slow, pulses, drives, args.rc, args.name or args.out.stem, progress)
    save_cell(identification.model, args.out)
    if args.plot is not None:
        draw_identification(args.plot, identification)
    read_notes = [(r.source, note) for r in (*slow, *pulses, *drives) for note in r.notes]
    if args.json:
        print(json.dumps(_report(identification, read_notes, args.out)))
    else:
        _print_report(identification, read_notes, args.out)
    return 0


def _report(identification: Identification, read_notes: list[tuple[str, str]], out: Path) -> dict[str, object]:
    parts = [{k: v for k, v in vars(part).items() if k not in ("soc", "residual_v")} for part in identification.parts]
    for part in parts:
        low, high = part["temperature_range_degc"]
        part["temperature_range_degc"] = None if math.isnan(low) else [low, high]
        if math.isnan(part["voltage_rms_v"]):
            part["voltage_rms_v"] = None
    model, evidence = identification.model, identification.model.evidence
    return {
        "cell": str(out),
        "capacity_ah": model.capacity_ah,
        "counted_ah": identification.counted_ah,
        "tau_s": list(identification.tau_s),
        "surface": asdict(model.surface) if model.surface else None,
        "sigma": dict(evidence.sigma) if evidence else {},
        "has_ocv": evidence is None or evidence.has_ocv,
        "next_test": identification.next_test,
        "fit_voltage_rms_v": model.fit_voltage_rms_v,
        "parts": parts,
        "notes": [f"{source}: {note}" for source, note in read_notes] + list(identification.notes),
        "warnings": list(identification.warnings),
    }


def _print_report(identification: Identification, read_notes: list[tuple[str, str]], out: Path) -> None:
    model, surface = identification.model, identification.model.surface
    for warning in identification.warnings:
        print(f"warning: {warning}")
    print(f"{out}: {model.capacity_ah:.4g} Ah")
    if surface is not None and model.evidence is not None:
        sigma = dict(model.evidence.sigma)
        for text, value, unit, name in _numbers(surface):
            share = sigma.get(name, math.nan)
            is_share = not name.endswith(("j_mol", "exponent"))
            shown = f"{100.0 * share:.0f} %" if is_share else f"{share / (1e3 if name.endswith('j_mol') else 1.0):.2g}"
            print(f"  {text}: {value:.3g} {unit}+- {shown}")
    print("  open-loop voltage error")
    for part in identification.parts:
        kind = "drive" if part.is_drive else "pulses"
        low, high = (100.0 * soc for soc in part.soc_range)
        print(
            f"    {part.name} ({kind}): {1e3 * part.voltage_rms_v:.1f} mV RMS, up to {part.current_max_a:.3g} A, "
            f"SOC {low:.0f} to {high:.0f} %"
        )
    for source, note in read_notes:
        print(f"  note: {source}: {note}")
    for note in identification.notes:
        print(f"  note: {note}")
    if identification.next_test is not None:
        print(f"  would help most: {identification.next_test}")


def _numbers(surface: SurfaceModel) -> Iterator[tuple[str, float, str, str]]:
    """Yield what the report says of each number: text, value, unit, and the name that its sigma has."""
    yield "ohmic resistance at 25 degC", 1e3 * surface.r0_ohm, "mohm ", "r0_ohm"
    yield "  its energy", surface.r0_j_mol / 1e3, "kJ/mol ", "r0_j_mol"
    yield "kinetics", 1e3 * surface.kinetics_v, "mV ", "kinetics_v"
    yield "  current at half charge", surface.kinetics_a, "A ", "kinetics_a"
    yield "  its energy", surface.kinetics_j_mol / 1e3, "kJ/mol ", "kinetics_j_mol"
    yield "  exponent towards empty", surface.low_exponent, "", "low_exponent"
    yield "  exponent towards full", surface.high_exponent, "", "high_exponent"
    for k, lag in enumerate(surface.lags, 1):
        yield f"lag {k}", lag.tau_s, "s ", "tau_s"
        yield "  surface SOC for each ampere", 100.0 * lag.soc_per_a, "% ", "soc_per_a"
        yield "  resistance", 1e3 * lag.r_ohm, "mohm ", "r_ohm"
    if surface.lags:
        yield "diffusion's energy", surface.diffusion_j_mol / 1e3, "kJ/mol ", "diffusion_j_mol"
