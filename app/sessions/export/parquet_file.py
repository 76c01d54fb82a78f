"""Parquet, by pyarrow: a float column a signal with its unit in name and metadata, null where nothing was sampled.

The last column is the time as a UTC timestamp, so that no reader has to be told what the seconds are.
"""

from pathlib import Path
from typing import Any

from app.sessions.errors import ExportUnavailable
from app.sessions.export.table import Rows, SignalTable, source_of
from app.sources.recordings.profile import EXPORT_STAMP, EXPORT_TIMES

ROW_GROUP_S = 600.0


def write_parquet(table: SignalTable, path: Path) -> None:
    """Write the file.

    Raises:
        ExportUnavailable: pyarrow is not installed.
    """
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError as error:
        raise ExportUnavailable("parquet", "pyarrow", "parquet") from error
    times = [pyarrow.field(name, pyarrow.float64(), metadata={"unit": "s"}) for name in EXPORT_TIMES]
    columns = [
        pyarrow.field(name, pyarrow.float64(), metadata={"unit": signal.unit})
        for name, signal in zip(table.columns, table.signals, strict=True)
    ]
    stamp = pyarrow.field(EXPORT_STAMP, pyarrow.timestamp("us", "UTC"))
    about = {"session": table.info.id, "name": table.info.name, "voltwall": table.info.voltwall} | source_of(table)
    schema = pyarrow.schema([*times, *columns, stamp], metadata=about)
    # Of these columns dictionaries make a larger file and cost a third of the time.
    with parquet.ParquetWriter(path, schema, compression="zstd", use_dictionary=False) as writer:
        for rows in table.rows(ROW_GROUP_S):
            writer.write_batch(pyarrow.record_batch(_arrays(pyarrow, rows), schema=schema))


def _arrays(pyarrow: Any, rows: Rows) -> list[Any]:
    columns = (rows.time_s, rows.elapsed_s, rows.uptime_s, *rows.values.T)
    stamps = pyarrow.array(rows.time_us, pyarrow.timestamp("us", "UTC"))
    return [*(pyarrow.array(column, from_pandas=True) for column in columns), stamps]
