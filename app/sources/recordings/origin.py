"""The origin of a recording, the simulated car or a real one: training data must never be taken for the car.

Each export of a simulated session says so where its format lets it: a column of a table, the channel of a candump log,
an event of ASC and BLF.
"""

import gzip
from pathlib import Path

import numpy as np

from app.sources.recordings.blf_log import first_container
from app.sources.recordings.kind import kind_of
from app.sources.recordings.table import GZIP_MAGIC, Table

SIMULATED_COLUMN = "simulated"  # 1 in every row
SIMULATED_CHANNEL = "simulated0"  # the one place that a candump log has for it
SIMULATED_MARK = "simulated car"
_BEGIN = 1 << 14  # bytes in which a log says it


def is_simulated_table(table: Table) -> bool:
    """Return whether a table is of the simulated car."""
    values = table.columns.get(SIMULATED_COLUMN)
    return values is not None and bool(np.any(values == 1.0))


def is_simulated_log(path: Path) -> bool:
    """Return whether a log of frames is of the simulated car."""
    kind = kind_of(path)
    with path.open("rb") as file:
        begin = file.read(_BEGIN)
        if kind == "blf":
            file.seek(0)
            return SIMULATED_MARK.encode() in first_container(file)
    if begin[:2] == GZIP_MAGIC:
        with gzip.open(path) as packed:
            begin = packed.read(_BEGIN)
    mark = SIMULATED_MARK if kind == "asc" else f" {SIMULATED_CHANNEL[:-1]}"
    return kind in ("asc", "candump") and mark.encode() in begin
