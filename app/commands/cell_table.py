"""The table that `voltwall estimate` writes, with the state of power along a recording."""

from __future__ import annotations

import gzip
from collections.abc import Iterator, Mapping, Sequence
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from app.commands.filter_run import DEFAULT_TEMPERATURE_DEGC, Run
from app.estimation.arrays import FloatArray
from app.estimation.cell_model.circuit import CellModel
from app.estimation.errors import DatasetError
from app.estimation.prediction.constant_current import OperatingPoint
from app.estimation.prediction.power import COVERAGE
from app.estimation.prediction.power_along import PowerAlong, branch_currents, limits_of, power_along, voltage_ahead
from app.estimation.recording.cell_recording import Recording
from app.sessions.export.csv_file import csv_row


def check_table_name(path: Path) -> None:
    """Raise DatasetError unless `write_table` knows the ending and the folder is there: before hours of work."""
    if not path.name.endswith((".csv", ".csv.gz", ".parquet")):
        raise DatasetError(str(path), "write to a name ending in .csv, .csv.gz or .parquet")
    if not path.parent.is_dir():
        raise DatasetError(str(path), "its folder does not exist")


def write_table(path: Path, columns: Mapping[str, FloatArray]) -> None:
    """Write (n,) columns as CSV, gzip CSV or Parquet by the ending of the name; NaN becomes an empty field in CSV.

    Raises:
        DatasetError: the ending is none of them, or Parquet is not installed.
        OSError: the file cannot be written.
    """
    check_table_name(path)
    if path.name.endswith(".parquet"):
        _write_parquet(path, columns)
        return
    buffer = StringIO()
    np.savetxt(buffer, np.column_stack(list(columns.values())), fmt="%.9g", delimiter=",")
    text = csv_row(columns) + buffer.getvalue().replace("nan", "")
    raw = text.encode()
    path.write_bytes(gzip.compress(raw, mtime=0) if path.name.endswith(".gz") else raw)


def _write_parquet(path: Path, columns: Mapping[str, FloatArray]) -> None:
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as exc:
        raise DatasetError(str(path), "writing Parquet needs the extra: pip install voltwall[parquet]") from exc
    pq.write_table(pa.table({name: pa.array(values) for name, values in columns.items()}), path)


def columns_of(recording: Recording, result: Run, powers: Sequence[PowerAlong]) -> dict[str, FloatArray]:
    """Return the columns of the table; of power and its band [W], and 1 where the current was never measured."""
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
    for power in powers:
        name = f"power_{power.direction}_{power.horizon_s:g}s"
        columns[f"{name}_w"] = power.power_w
        columns[f"{name}_low_w"] = power.low_w
        columns[f"{name}_high_w"] = power.high_w
        columns[f"{name}_beyond_measured"] = power.beyond_measured.astype(np.float64)
    return columns


def power_of(recording: Recording, result: Run, cell: CellModel) -> Iterator[PowerAlong]:
    """Return the state of power at every row of a recording that was estimated."""
    degc = np.where(np.isnan(recording.temperature_degc), DEFAULT_TEMPERATURE_DEGC, recording.temperature_degc)
    branches = branch_currents(cell, recording.step_s, recording.current_a, result.soc, degc)
    states = OperatingPoint(result.soc, branches, degc)
    current_a, voltage_v = recording.current_a, recording.voltage_v
    foretold = voltage_ahead(cell, recording.time_s, current_a, voltage_v, states, result.soc_sigma)
    return power_along(cell, states, result.soc_sigma, foretold.scale)


def power_summary(powers: Sequence[PowerAlong], cell: CellModel) -> dict[str, Any]:
    """Return the state of power at the last row and its extremes, and under which condition it holds."""
    limits = limits_of(cell)
    return {
        "power_coverage": COVERAGE,
        "power_measured_current_max_a": cell.fit_current_max_a or None,
        "power_limits": {
            "v_min_v": limits.v_min_v,
            "v_max_v": limits.v_max_v,
            "discharge_max_a": cell.limits.discharge_max_a,
            "charge_max_a": cell.limits.charge_max_a,
            "temperature_max_degc": limits.temperature_max_degc,
        },
        "power": [
            {
                "direction": power.direction,
                "horizon_s": power.horizon_s,
                "last_w": float(power.power_w[-1]),
                "last_low_w": float(power.low_w[-1]),
                "last_high_w": float(power.high_w[-1]),
                "least_w": float(power.power_w.min()),
                "largest_w": float(power.power_w.max()),
                "beyond_measured_frac": float(power.beyond_measured.mean()) if cell.fit_current_max_a else None,
            }
            for power in powers
        ],
    }
