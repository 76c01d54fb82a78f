"""`voltwall estimate`: run a filter over a recording of one cell and, where the SOC is known, score it."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.commands.arguments import add_reading_arguments, read_recording
from app.commands.console import Progress, fraction
from app.estimation.filters.filter_names import FILTERS

if TYPE_CHECKING:
    from app.commands.filter_run import Run
    from app.estimation.cell_model.circuit import CellModel
    from app.estimation.recording.cell_recording import Recording
    from app.estimation.scoring import InnovationScore, SocScore


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.set_defaults(run=run)
    parser.description = "Estimate the SOC along a recording, and its error if the file has a soc column."
    parser.add_argument("file", type=Path, metavar="FILE", help="recording: CSV or Parquet, also gzipped")
    parser.add_argument("--cell", required=True, metavar="CELL.toml", help="cell file or bundled cell")
    parser.add_argument("--filter", choices=FILTERS, default="fused", help="filter (default: %(default)s)")
    parser.add_argument(
        "--initial-soc",
        type=fraction,
        metavar="S",
        help="initial SOC, 0..1 or with %% (default: from the first voltage)",
    )
    parser.add_argument(
        "--initial-sigma", type=fraction, metavar="S", help="its uncertainty, 1 sigma (default: that of the filter)"
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the estimates: .csv, .csv.gz or .parquet")
    parser.add_argument(
        "--power",
        action="store_true",
        help="also estimate the power limits for 1, 10 and 30 s [W] with 90 %% intervals",
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="plot SOC with 3 sigma, voltage and residual")
    add_reading_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Run the command.

    Raises:
        EstimatorError: a file cannot be used.
    """
    from app.commands import cell_charts, cell_table
    from app.commands.filter_run import run_filter
    from app.estimation.cell_model.cell_file import load_cell
    from app.estimation.filters.estimators import make_estimator
    from app.estimation.recording.cell_recording import believable
    from app.estimation.scoring import score_innovations, score_soc

    if args.out is not None:
        cell_table.check_table_name(args.out)  # before hours of work
    if args.plot is not None:
        cell_charts.check_picture_name(args.plot)
    cell = load_cell(args.cell)
    recording = believable(read_recording(args.file, args), cell.capacity_ah)
    estimator = make_estimator(args.filter, cell, 1)
    with Progress(recording.source) as progress:
        start = args.initial_soc, args.initial_sigma
        result = run_filter(estimator, recording, cell.capacity_ah, *start, cell, progress)
    score = score_soc(recording.time_s, result.soc, result.soc_sigma, recording.soc)
    white = score_innovations(recording.time_s, result.innovation_v, result.innovation_sigma_v)
    report = summary(args, recording, result, cell, score, white)
    powers = list(cell_table.power_of(recording, result, cell)) if args.power else []
    if args.power:
        report |= cell_table.power_summary(powers, cell)
    if args.out is not None:
        cell_table.write_table(args.out, cell_table.columns_of(recording, result, powers))
    if args.plot is not None:
        cell_charts.draw_estimate(args.plot, recording, result)
    if args.json:
        print(json.dumps(report, allow_nan=False))
    else:
        _print_report(report)
        if args.power:
            _print_power(report)
    return 0


def summary(
    args: argparse.Namespace,
    recording: Recording,
    result: Run,
    cell: CellModel,
    score: SocScore | None,
    white: InnovationScore | None,
) -> dict[str, Any]:
    """Return the result as plain JSON values; what is missing is None."""
    import numpy as np

    from app.commands.filter_run import gap_notes, outside_notes
    from app.estimation.scoring import InnovationScore, SocScore

    scores = dict.fromkeys(f.name for f in fields(SocScore)) if score is None else asdict(score)
    lasting = dict.fromkeys(f.name for f in fields(InnovationScore)) if white is None else asdict(white)
    innovation = result.innovation_v[np.isfinite(result.innovation_v)]
    report = {
        "file": recording.source,
        "cell": str(args.cell),
        "filter": args.filter,
        "rows": len(recording.time_s),
        "duration_s": float(recording.time_s[-1] - recording.time_s[0]),
        "initial_soc": args.initial_soc,
        **scores,
        "soc_first": float(result.soc[0]),
        "soc_last": float(result.soc[-1]),
        "soc_sigma_last": float(result.soc_sigma[-1]),
        "innovation_rms_v": float(np.sqrt(np.mean(innovation**2))) if innovation.size else None,
        **lasting,
        "current_offset_a": None if result.sensor is None else result.sensor.offset_a,
        "current_offset_sigma_a": None if result.sensor is None else result.sensor.sigma_a,
        "current_offset_observed": None if result.sensor is None else result.sensor.is_observed,
        "capacity_ah": result.capacity_ah,
        "capacity_sigma_ah": result.capacity_sigma_ah,
        "resistance_factor": result.resistance_factor,
        "resistance_factor_sigma": result.resistance_sigma,
        "model_valid": result.model_valid_frac,
        "us_per_step": result.us_per_step,
        "notes": [*recording.notes, *gap_notes(recording, cell.capacity_ah), *outside_notes(recording, cell)],
    }
    return {
        key: None if isinstance(value, float) and not np.isfinite(value) else value for key, value in report.items()
    }


def _print_report(report: dict[str, Any]) -> None:
    def percent(name: str) -> str:
        return "unknown" if report[name] is None else f"{100.0 * report[name]:.2f} %"

    def seconds(name: str) -> str:
        return "never" if report[name] is None else f"{report[name]:.1f} s"

    print(f"{report['file']}: {report['rows']} rows over {report['duration_s']:.0f} s, filter {report['filter']}")
    for note in report["notes"]:
        print(f"  note: {note}")
    print(f"  SOC {percent('soc_first')} at the first row, {percent('soc_last')} at the last")
    print(f"  sigma at the last row {percent('soc_sigma_last')}; model valid {percent('model_valid')} of the time")
    if report["nis"] is not None:
        print(
            f"  innovations: {1e3 * report['innovation_rms_v']:.1f} mV RMS, NIS {report['nis']:.2f}, last "
            f"{report['innovation_correlation_s']:.1f} s, {percent('innovation_white_share')} of 20 lags look white"
        )
    if report["current_offset_sigma_a"] is not None:
        suffix = "" if report["current_offset_observed"] else ": not observable in this run"
        print(
            f"  offset of the current sensor {report['current_offset_a']:+.3g} A, "
            f"sigma {report['current_offset_sigma_a']:.2g} A{suffix}"
        )
    print(
        f"  capacity {report['capacity_ah']:.4g} Ah, sigma {report['capacity_sigma_ah']:.2g} Ah; resistance "
        f"{report['resistance_factor']:.2f} times the cell file's, sigma {report['resistance_factor_sigma']:.2g}"
    )
    print(f"  {report['us_per_step']:.0f} us for a step")
    if report["soc_rmse"] is None:
        print("  no soc column: nothing to compare with")
        return
    print(f"  RMSE {percent('soc_rmse')}, largest error after 60 s {percent('soc_max_error_after_60s')}")
    print(f"  within 5 % after {seconds('settle_5_s')}, within 2 % after {seconds('settle_2_s')}")
    print(f"  within 3 sigma {percent('inside_3_sigma')} of the time")


def _print_power(report: dict[str, Any]) -> None:
    """Print the summary."""
    print(
        f"  state of power at the last row, bands contain the truth in {100 * report['power_coverage']:.0f} % of cases:"
    )
    for row in report["power"]:
        print(
            f"    {row['direction']:9} {row['horizon_s']:2g} s {row['last_w']:8.1f} W "
            f"({row['last_low_w']:.1f} to {row['last_high_w']:.1f}), along the recording {row['least_w']:.1f} to "
            f"{row['largest_w']:.1f} W{_beyond(row['beyond_measured_frac'])}"
        )
    limits, measured_a = report["power_limits"], report["power_measured_current_max_a"]
    if limits["discharge_max_a"] is None or limits["charge_max_a"] is None:
        print("    the cell file has no current limits: only voltage, SOC and temperature limit")
    if measured_a is None:
        print("    the measured current range of the cell file is unknown")
    elif any(row["beyond_measured_frac"] for row in report["power"]):
        measured = f"currents (up to {measured_a:.3g} A, less for longer) or temperatures"
        print(f"    extrapolated where marked: beyond the {measured} that the cell file was measured with")


def _beyond(share: float | None) -> str:
    return f", extrapolated {100 * share:.0f} % of the time" if share else ""
