"""Parquet, by pyarrow: a float column a signal with its unit in name and metadata, null where nothing was sampled."""

from pathlib import Path
from typing import Any

from app.sessions.errors import ExportUnavailable
from app.sessions.export.table import Block, SignalTable, column_name


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
    times = [
        pyarrow.field(name, pyarrow.float64(), metadata={"unit": "s"}) for name in ("time_s", "elapsed_s", "uptime_s")
    ]
    columns = [
        pyarrow.field(column_name(signal), pyarrow.float64(), metadata={"unit": signal.unit})
        for signal in table.signals
    ]
    about = {"session": table.info.id, "name": table.info.name, "voltwall": table.info.voltwall}
    schema = pyarrow.schema([*times, *columns], metadata=about)
    with parquet.ParquetWriter(path, schema, compression="zstd") as writer:
        for block in table.blocks():
            writer.write_batch(pyarrow.record_batch(_arrays(pyarrow, block), schema=schema))


def _arrays(pyarrow: Any, block: Block) -> list[Any]:
    columns = (block.time_s, block.elapsed_s, block.uptime_s, *block.values.T)
    return [pyarrow.array(column, from_pandas=True) for column in columns]
