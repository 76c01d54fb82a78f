"""`voltwall balance`: what each balancing circuit makes of a charge or a rest, simulated."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from app.commands.console import Progress, between, segments
from app.errors import ConfigError
from simulator.balancing.choices import CIRCUITS, LIMITS
from simulator.errors import ParameterError

if TYPE_CHECKING:
    from simulator.balancing.charge import BalancingRun
    from simulator.balancing.study import Study

DESCRIPTION = """\
Simulate a charge or a rest with each balancing circuit: duration, temperature, remaining
spread and losses. Balancing resistors follow the measured voltages while charging; at rest, and with transformers,
the cell is chosen by its true SOC, which a real master knows less exactly.
"""
EPILOG = """\
examples:
  voltwall balance                                  the car's 8 packs of 12, charged at 0.5C from 20 %
  voltwall balance --rest --soc 90 --hours 12       at rest
  voltwall balance --thesis --rate 1 --resistor 40  six cells of the balancing thesis, with its results
  voltwall balance --segments 1x14 --circuit transformer --spread 5 --picture balance.svg
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.set_defaults(run=run)
    parser.description, parser.epilog = DESCRIPTION, EPILOG
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument(
        "--circuit",
        action="append",
        choices=CIRCUITS,
        help="circuit to simulate, repeatable (default: all, and none for comparison)",
    )
    parser.add_argument(
        "--thesis", action="store_true", help="use the six cells of the balancing thesis instead of the car's"
    )
    parser.add_argument(
        "--packs", "--segments", dest="segments", type=segments, metavar="8x12",
        help="packs x series cells per pack (default: 8x12; with --thesis 1x6)",
    )  # fmt: skip
    kind = parser.add_mutually_exclusive_group()
    kind.add_argument(
        "--rate", type=between(*LIMITS["rate_c"], "C"), metavar="C",
        help="charging current as a C-rate (default: 0.5)",
    )  # fmt: skip
    kind.add_argument("--rest", action="store_true", help="balance at rest, until --until or --hours")
    parser.add_argument("--hours", type=between(*LIMITS["hours"], "h"), help="maximum duration (default: 24)")
    percent = {"soc": "mean SOC at the start", "spread": "SOC spread (max - min) at the start"}
    for name, meaning in percent.items():
        low, high = LIMITS[name]
        parser.add_argument(
            f"--{name}", type=between(100 * low, 100 * high, "percent"), metavar="PERCENT", help=f"{meaning}"
        )
    low, high = LIMITS["until"]
    parser.add_argument(
        "--until", type=between(100 * low, 100 * high, "percent"), metavar="PERCENT",
        help="end a rest at this SOC spread",
    )  # fmt: skip
    parser.add_argument(
        "--temperature", type=between(*LIMITS["ambient_degc"], "degC"), metavar="DEGC", help="ambient temperature"
    )
    parser.add_argument(
        "--resistor", type=between(*LIMITS["resistor_ohm"], "ohm"), metavar="OHM", help="balancing resistor"
    )
    low, high = LIMITS["threshold_v"]
    parser.add_argument(
        "--threshold", type=between(1e3 * low, 1e3 * high, "mV"), metavar="MV",
        help="balance a charging cell above the lowest by more than this",
    )  # fmt: skip
    parser.add_argument("--seed", type=int, help="random seed of the cell spread (default: 1)")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="write a plot; needs the extra voltwall[plot]")
    parser.add_argument("--json", action="store_true", help="print results and time series as JSON")


def run(args: argparse.Namespace) -> int:
    """Simulate, print, draw.

    Raises:
        ConfigError: a number is beyond what the model means.
    """
    from app.commands.cell_charts import check_picture_name
    from simulator.balancing.study import run_study

    try:
        study = _study(args)
    except ParameterError as error:
        raise ConfigError(error.name, error.value, error.rule) from error
    if args.picture is not None:
        check_picture_name(args.picture)
    circuits = tuple(dict.fromkeys(args.circuit or CIRCUITS))
    if not args.json:
        print(_title(study))
        print(f"{'':20}{'hours':>8}{'hottest':>12}{'left':>10}{'in a pack':>11}{'lost':>12}  ended by")
    runs, progress = {}, Progress("balance")
    for k, circuit in enumerate(circuits):
        with progress:
            runs[circuit] = run_study(study, circuit, progress.share(k, len(circuits)))
        if not args.json:
            print(_line(study, circuit, runs[circuit]), flush=True)
    if args.json:
        print(json.dumps(_document(study, runs), indent=2, allow_nan=False))
    if args.picture is not None:
        _draw(args.picture, study, runs)
    return 0


def _study(args: argparse.Namespace) -> Study:
    from simulator.balancing.study import study_of

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
    from simulator.balancing.study import difference_within_packs, thesis_figures

    left, within = 100 * done.soc_difference, 100 * difference_within_packs(study, done)
    planned = "difference reached" if study.rate_c is None else "end current"
    line = (
        f"{circuit:20}{done.hours:8.2f}{done.max_degc:7.1f} degC{left:8.3f} %{within:9.3f} %"
        f"{done.balancing_loss_wh:9.2f} Wh  {done.stopped_by or planned}"
    )
    published = thesis_figures(study, circuit)
    if published is None:
        return line
    return f"{line}\n{'  in the thesis':20}{published[0]:8.2f}{published[1]:7.1f} degC{published[2]:8.3f} %"


def _document(study: Study, runs: dict[str, BalancingRun]) -> dict[str, object]:
    from simulator.balancing.study import figures_of

    circuits = {name: figures_of(study, name, run) for name, run in runs.items()}
    return {"study": {**asdict(study), "start_soc": study.start_soc.tolist()}, "circuits": circuits}


def _draw(path: Path, study: Study, runs: dict[str, BalancingRun]) -> None:
    import numpy as np

    from app.commands.cell_charts import REFERENCE, SHADES, new_figure, put_legends

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
