"""CSV: one header line, one row an instant, empty where nothing was sampled."""

import math
from collections.abc import Iterator

import numpy as np

from app.sessions.export.table import SignalTable, column_name
from app.sessions.storage.signals import Signal

_TIMES = ("time_s", "elapsed_s", "uptime_s")


def csv_parts(table: SignalTable) -> Iterator[bytes]:
    """Yield the file, piece by piece, in UTF-8."""
    yield (",".join([*_TIMES, *(column_name(signal) for signal in table.signals)]) + "\n").encode()
    line = "%.3f,%.3f,%.3f," + ",".join(f"%.{_decimals(signal)}f" for signal in table.signals) + "\n"
    for block in table.blocks():
        rows = np.column_stack((block.time_s, block.elapsed_s, block.uptime_s, block.values))
        yield "".join([line % tuple(row) for row in rows.tolist()]).replace("nan", "").encode()


def _decimals(signal: Signal) -> int:
    """As many as one count can be told from the next with."""
    return max(0, math.ceil(-math.log10(signal.scale) - 1e-9))
