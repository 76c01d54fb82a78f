"""A session's signals as a file of one of the formats."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from app.errors import ConfigError
from app.sessions.errors import ExportUnavailable
from app.sessions.export.can_log import write_asc, write_blf, write_candump
from app.sessions.export.csv_file import csv_parts
from app.sessions.export.formats import FORMATS, NAMES, Names
from app.sessions.export.ld_file import write_ld, write_ldx, write_motec
from app.sessions.export.mcap_file import write_mcap
from app.sessions.export.mf4_file import write_mf4
from app.sessions.export.table import Rows, SignalTable, source_of
from app.sessions.reading.reader import SessionFile
from app.sources.recordings.import_mapping import EXPORT_STAMP, EXPORT_TIMES
from app.words import Message

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


def write_csv(table: SignalTable, path: Path) -> None:
    """Write the file."""
    with path.open("wb") as file:
        for part in csv_parts(table):
            file.write(part)


WRITERS: dict[str, Callable[[SignalTable, Path], None]] = {
    "csv": write_csv,
    "parquet": write_parquet,
    "mcap": write_mcap,
    "mf4": write_mf4,
    "ld": write_ld,
    "motec": write_motec,
    "ldx": write_ldx,
    "candump": write_candump,
    "asc": write_asc,
    "blf": write_blf,
}


def export(
    session: SessionFile,
    path: Path,
    export_format: str,
    *,
    signals: Sequence[str] | None = None,
    t_from_s: float | None = None,
    t_to_s: float | None = None,
    lap_times_s: Sequence[float] | None = None,
    names: Names = "index",
    on_progress: Callable[[int, int], None] = lambda done, of: None,
) -> None:
    """Write signals of a range, both ends in unix time and included, as a file.

    It appears whole or not at all: an export that is cut off leaves what was there before. `on_progress` gets how
    much of how much is read.

    Raises:
        ConfigError: there is no such format, nothing for it, or no such names in it.
        UnknownSignal: a name means nothing.
        ExportUnavailable: the format needs a package that is not installed.
        OSError: the file cannot be written.
    """
    if export_format not in FORMATS:
        raise ConfigError("format", export_format, Message("one-of", choices=tuple(FORMATS)))
    shown = NAMES if FORMATS[export_format].has_names else NAMES[:1]
    if names not in shown:
        raise ConfigError("names", names, Message("one-of", choices=shown))
    table = SignalTable(
        session, signals, t_from_s, t_to_s, lap_times_s=lap_times_s, names=names, on_progress=on_progress
    )
    if path.exists() and not path.is_file():  # a device or a pipe
        WRITERS[export_format](table, path)
        return
    part = path.with_name(f".part-{path.name}")
    try:
        WRITERS[export_format](table, part)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
