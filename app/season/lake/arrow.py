"""The schema of the lake as Arrow has it, and the names of its files: what a reader needs, and no session is read."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from app.errors import ExtraMissing
from app.season.lake.schema import SAMPLES, TABLES, Column
from app.words import Message


def pyarrow_or_error() -> Any:
    """Return pyarrow.

    Raises:
        ExtraMissing: it is not installed.
    """
    try:
        import pyarrow
    except ImportError as error:
        raise ExtraMissing(Message("the-season-lake"), "pyarrow", "season") from error
    return pyarrow


def arrow_schema(columns: Sequence[Column], about: dict[str, str] | None = None) -> Any:
    """Return columns as an Arrow schema with unit and meaning of each."""
    pa = pyarrow_or_error()
    types = {
        "text": pa.string(),
        "number": pa.float64(),
        "count": pa.int32(),
        "time": pa.timestamp("us", "UTC"),
        "flag": pa.bool_(),
    }
    fields = [
        pa.field(each.name, types[each.type], metadata={"unit": each.unit, "meaning": each.meaning}) for each in columns
    ]
    return pa.schema(fields, metadata=about)


def name_of_table(name: str) -> str:
    """Return the file name of a table: one of `TABLES`, or `SAMPLES`."""
    if name not in TABLES and name != SAMPLES:
        raise KeyError(name)
    return f"{name}.parquet"
