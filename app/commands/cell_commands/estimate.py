"""`voltwall estimate`: run a filter over a recording of one cell and, where the SOC is known, score it."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict, fields
from typing import Any

import numpy as np

from app.commands.cell_commands.charts import check_picture_name, draw_estimate
from app.commands.cell_commands.filter_run import Run, gap_notes, outside_notes, run_filter
from app.commands.cell_commands.power import power_columns, power_of, power_summary, print_power
from app.commands.cell_commands.recordings import check_table_name, read_recording, write_table
from app.commands.console.progress import Progress, leave_no_line
from app.estimation.arrays import FloatArray
from app.estimation.cell_model.cell_file import load_cell
from app.estimation.cell_model.circuit import CellModel
from app.estimation.errors import DatasetError, EstimatorError
from app.estimation.filters.estimators import make_estimator
from app.estimation.recording.cell_recording import Recording, believable
from app.estimation.scoring.scoring import SocScore, score_soc
from app.estimation.scoring.whiteness import InnovationScore, score_innovations


def check_outputs(args: argparse.Namespace) -> None:
    """Raise DatasetError for a file that could not be written at the end."""
    if args.out is not None:
        check_table_name(args.out)
    if args.plot is not None:
        check_picture_name(args.plot)


def run(args: argparse.Namespace) -> int:
    """Run the command; 0 when done, 2 when a file cannot be used."""
    try:
        check_outputs(args)
        cell = load_cell(args.cell)
        recording = believable(read_recording(args.file, args), cell.capacity_ah)
        estimator = make_estimator(args.filter, cell, 1)
        progress = Progress(recording.source)
        start = args.initial_soc, args.initial_sigma
        result = run_filter(estimator, recording, cell.capacity_ah, *start, cell, progress)
        progress.end()
        score = score_soc(recording.time_s, result.soc, result.soc_sigma, recording.soc)
        white = score_innovations(recording.time_s, result.innovation_v, result.innovation_sigma_v)
        report = summary(args, recording, result, cell, score, white)
        held = list(power_of(recording, result, cell)) if args.power else []
        if args.power:
            report |= power_summary(held, cell)
        if args.out is not None:
            write_table(args.out, _columns(recording, result) | power_columns(held))
        if args.plot is not None:
            draw_estimate(args.plot, recording, result)
    except (DatasetError, EstimatorError, OSError) as exc:
        leave_no_line()
        print(f"voltwall estimate: {exc}", file=sys.stderr)
        return 2
    if args.json:
        print(json.dumps(report, allow_nan=False))
    else:
        _print_report(report)
        if args.power:
            print_power(report)
    return 0


def summary(
    args: argparse.Namespace,
    recording: Recording,
    result: Run,
    cell: CellModel,
    score: SocScore | None,
    white: InnovationScore | None,
) -> dict[str, Any]:
    """Return the result as plain JSON values; what cannot be said is None."""
    names = (
        "soc_rmse",
        "soc_bias",
        "soc_max_error_after_60s",
        "settle_5_s",
        "settle_2_s",
        "inside_3_sigma",
        "sigma_rms",
        "nees",
    )
    scores = dict.fromkeys(names) if score is None else asdict(score)
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


def _columns(recording: Recording, result: Run) -> dict[str, FloatArray]:
    columns = {
        "time_s": recording.time_s,
        "current_a": recording.current_a,
        "voltage_v": recording.voltage_v,
        "soc": result.soc,
        "soc_sigma": result.soc_sigma,
        "voltage_model_v": result.voltage_v,
        "innovation_v": result.innovation_v,
        "innovation_sigma_v": result.innovation_sigma_v,
    }
    if np.isfinite(recording.soc).any():
        columns["soc_reference"] = recording.soc
    return columns


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
