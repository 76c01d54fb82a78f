"""`voltwall balance`: what each balancing circuit makes of a charge or a rest, simulated."""

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path

import numpy as np

from app.commands.cell_commands.charts import REFERENCE, SHADES, check_picture_name, new_figure, put_legends
from app.commands.console.progress import Progress
from app.estimation.errors import DatasetError
from simulator.balancing.charge import BalancingRun, OnProgress
from simulator.balancing.choices import CIRCUITS
from simulator.balancing.study import (
    Study,
    difference_within_packs,
    figures_of,
    run_study,
    study_of,
    thesis_figures,
)
from simulator.errors import ParameterError


def run(args: argparse.Namespace) -> int:
    """Simulate, print, draw."""
    try:
        study = _study(args)
        if args.picture is not None:
            check_picture_name(args.picture)
    except (ParameterError, DatasetError) as error:
        print(f"voltwall balance: {error}", file=sys.stderr)
        return 2
    circuits = tuple(dict.fromkeys(args.circuit or CIRCUITS))
    if not args.json:
        print(_title(study))
        print(f"{'':20}{'hours':>8}{'hottest':>12}{'left':>10}{'in a pack':>11}{'lost':>12}  ended by")
    runs, progress = {}, Progress("balance")
    for k, circuit in enumerate(circuits):
        runs[circuit] = run_study(study, circuit, _share_of(progress, k, len(circuits)))
        progress.end()
        if not args.json:
            print(_line(study, circuit, runs[circuit]), flush=True)
    if args.json:
        print(json.dumps(_document(study, runs), indent=2, allow_nan=False))
    if args.picture is not None:
        _draw(args.picture, study, runs)
    return 0


def _share_of(progress: Progress, k: int, of: int) -> OnProgress:
    """What tells the progress of circuit number `k` as that of all."""
    return lambda done, parts: progress(parts * k + done, parts * of)


def _study(args: argparse.Namespace) -> Study:
    return study_of(
        thesis=args.thesis,
        rest=args.rest,
        packs=args.segments,
        rate_c=args.rate,
        hours=args.hours,
        soc=_fraction(args.soc),
        spread=_fraction(args.spread),
        until=_fraction(args.until),
        ambient_degc=args.temperature,
        resistor_ohm=args.resistor,
        threshold_v=None if args.threshold is None else args.threshold / 1e3,
        seed=args.seed,
    )


def _fraction(percent: float | None) -> float | None:
    return None if percent is None else percent / 100


def _title(study: Study) -> str:
    whose = "of the balancing thesis" if study.cells == "thesis" else "of the car"
    what = "rest" if study.rate_c is None else f"charge at {study.rate_c:g}C ({study.rate_c * study.rated_ah:.4g} A)"
    soc = study.start_soc
    return (
        f"{study.n_cells} cells {whose} ({study.n_packs}x{study.per_pack}), {what}, air of {study.ambient_degc:g} degC,"
        f" SOC {100 * soc.min():.1f} to {100 * soc.max():.1f} %, {study.resistor_ohm:g} ohm"
    )


def _line(study: Study, circuit: str, done: BalancingRun) -> str:
    left, within = 100 * done.soc_difference, 100 * difference_within_packs(study, done)
    planned = "difference reached" if study.rate_c is None else "end current"
    line = (
        f"{circuit:20}{done.hours:8.2f}{done.max_degc:7.1f} degC{left:8.3f} %{within:9.3f} %"
        f"{done.balancing_loss_wh:9.2f} Wh  {done.stopped_by or planned}"
    )
    known = thesis_figures(study, circuit)
    if known is None:
        return line
    return f"{line}\n{'  in the thesis':20}{known[0]:8.2f}{known[1]:7.1f} degC{known[2]:8.3f} %"


def _document(study: Study, runs: dict[str, BalancingRun]) -> dict[str, object]:
    circuits = {name: figures_of(study, name, run) for name, run in runs.items()}
    return {"study": {**asdict(study), "start_soc": study.start_soc.tolist()}, "circuits": circuits}


def _draw(path: Path, study: Study, runs: dict[str, BalancingRun]) -> None:
    is_charge = study.rate_c is not None
    figure, axes = new_figure(path, 3 if is_charge else 2, "Balancing", _title(study))
    for (name, done), colour in zip(runs.items(), (*SHADES[:3], REFERENCE), strict=False):
        axes[0].plot(done.time_h, 100 * np.ptp(done.soc, axis=1), color=colour, label=name)
        axes[1].plot(done.time_h, done.temperature_degc.max(axis=1), color=colour)
        if is_charge:
            axes[2].plot(done.time_h, done.current_a, color=colour)
            axes[2].set_ylabel("charger / A")
    axes[0].set_ylabel("highest less lowest SOC / %")
    axes[0].set_ylim(bottom=0.0)
    axes[1].set_ylabel("hottest cell / degC")
    axes[-1].set_xlabel("time / h")
    put_legends(axes)
    figure.savefig(path, dpi=110)
