"""A recorded current as a load: a CSV file with `time_s` and `current_a`, or one that a session was exported to."""

import csv
import gzip
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from simulator.errors import ParameterError
from simulator.loads import Recorded

_CURRENT_COLUMNS = ("current_a", "i_fc (A)", "i_fs (A)")  # ours first, then those of an exported session
_AMBIENT_COLUMN = "ambient_degc"


def load_recording(path: Path) -> Recorded:
    """Read a CSV file (plain or .gz); rows without a current are skipped, repeated times keep the last one.

    Raises:
        ParameterError: no column for time or current, a value that is no number, or fewer than two rows.
        OSError: the file cannot be read.
    """
    opener = gzip.open if path.suffix == ".gz" else open
    with opener(path, "rt", newline="") as stream:
        reader = csv.DictReader(stream)
        names = list(reader.fieldnames or [])
        current = next((name for name in _CURRENT_COLUMNS if name in names), None)
        if current is None or "time_s" not in names:
            raise ParameterError("columns", names, f"needs time_s and one of {', '.join(_CURRENT_COLUMNS)}")
        has_ambient = _AMBIENT_COLUMN in names
        columns = ("time_s", current, *([_AMBIENT_COLUMN] if has_ambient else []))
        try:
            table = np.array(list(_numbers(reader, columns))).reshape(-1, len(columns))
        except (TypeError, ValueError) as error:
            raise ParameterError("file", str(path), f"not a number: {error}") from error
    later = np.append(np.diff(table[:, 0]) > 0, True)
    table = table[later]
    return Recorded(table[:, 0], table[:, 1], table[:, 2] if has_ambient else None)


def _numbers(reader: "csv.DictReader[str]", columns: tuple[str, ...]) -> Iterator[list[float]]:
    for row in reader:
        if row[columns[1]]:
            yield [float(row[name]) for name in columns]
