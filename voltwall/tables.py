"""Columns over time or over cells, for whatever library the caller likes."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from app.estimation.arrays import FloatArray
from app.season.lake.schema import pyarrow_or_error

if TYPE_CHECKING:
    import pyarrow


class Closing:
    """An object that is closed at the end of a `with`."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Let go of what is held open."""
        raise NotImplementedError


@dataclass(frozen=True)
class Table:
    """A table in memory. Times are timestamps in UTC; the metadata of a column tell its `unit`."""

    arrow: pyarrow.Table

    def to_arrow(self) -> pyarrow.Table:
        """Return it as a pyarrow table."""
        return self.arrow

    def to_pandas(self) -> Any:
        """Return it as a pandas DataFrame; one over time has `time` as its index.

        Raises:
            ImportError: pandas is not installed.
        """
        _needs("pandas", "to_pandas")
        frame = self.arrow.to_pandas()
        return frame.set_index("time") if self.arrow.column_names[:1] == ["time"] else frame

    def to_polars(self) -> Any:
        """Return it as a Polars DataFrame.

        Raises:
            ImportError: Polars is not installed.
        """
        return _needs("polars", "to_polars").from_arrow(self.arrow)

    def rows(self) -> list[dict[str, Any]]:
        """Return it as plain values, one dictionary a row."""
        rows: list[dict[str, Any]] = self.arrow.to_pylist()
        return rows

    @property
    def units(self) -> dict[str, str]:
        """Unit of each column that has one."""
        metadata = {field.name: field.metadata or {} for field in self.arrow.schema}
        return {
            name: metadata_of[b"unit"].decode() for name, metadata_of in metadata.items() if metadata_of.get(b"unit")
        }

    def __len__(self) -> int:
        return int(self.arrow.num_rows)


def over_time(time_s: FloatArray, names: Sequence[str], units: Sequence[str], values: FloatArray) -> Table:
    """Return (n,) unix times and (n, k) values as a table, NaN as null.

    Raises:
        ExtraMissing: pyarrow is not installed.
    """
    pa = pyarrow_or_error()
    time = pa.field("time", pa.timestamp("us", "UTC"))
    fields = [pa.field(name, pa.float64(), metadata={"unit": unit}) for name, unit in zip(names, units, strict=True)]
    columns = [pa.array(np.ascontiguousarray(column), from_pandas=True) for column in values.T]
    times = pa.array(np.round(time_s * 1e6).astype(np.int64), pa.timestamp("us", "UTC"))
    return Table(pa.Table.from_arrays([times, *columns], schema=pa.schema([time, *fields])))


def _needs(package: str, what: str) -> Any:
    try:
        return importlib.import_module(package)
    except ImportError as error:
        raise ImportError(f"{what} needs {package}: pip install {package}", name=package) from error
