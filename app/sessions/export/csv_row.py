"""Rows of CSV as every table of the program is written: no cell that a spreadsheet would run."""

import csv
import re
from collections.abc import Iterable
from io import StringIO

_RUNS = ("=", "+", "-", "@", "\t", "\r", "\n")  # what a formula begins with, also behind what is skipped
_NUMBER = re.compile(r"[+-]?(?:\d++\.?\d*+|\.\d++)(?:[eE][+-]?\d++)?", re.ASCII)


def csv_row(cells: Iterable[object]) -> str:
    """Return a line with its end; None is empty, numbers stay numbers, a text like a formula gets a leading '."""
    line = StringIO()
    csv.writer(line).writerow([_safe(cell) for cell in cells])  # its own line end: a CR in a cell is quoted, too
    return line.getvalue()[:-2] + "\n"


def _safe(cell: object) -> object:
    if cell is None or isinstance(cell, int | float):
        return cell
    text = str(cell)
    return f"'{text}" if text.startswith(_RUNS) and not _NUMBER.fullmatch(text) else text
