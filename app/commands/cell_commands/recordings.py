"""What the commands on recordings share: the arguments that say how to read a file, and writing a table."""

from __future__ import annotations

import argparse
import gzip
from collections.abc import Mapping
from io import StringIO
from pathlib import Path

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.errors import DatasetError
from app.estimation.recording.cell_recording import Recording
from app.sessions.export.csv_file import csv_row
from app.sources.recordings.dataset import load_recording, parse_map


def read_recording(path: Path, args: argparse.Namespace) -> Recording:
    """Return the recording in a file, read as the arguments say.

    Raises:
        DatasetError: see `app.sources.recordings.dataset.load_recording`.
    """
    return load_recording(path, parse_map(args.map), charge_positive=args.charge_positive, period_s=args.period)


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
