"""A session's signals as a file of one of the formats."""

from collections.abc import Callable, Sequence
from pathlib import Path

from app.errors import ConfigError
from app.sessions.export.can_log import write_asc, write_blf, write_candump
from app.sessions.export.csv_file import csv_parts
from app.sessions.export.formats import FORMATS, NAMES, Names
from app.sessions.export.ld_file import write_ld, write_ldx, write_motec
from app.sessions.export.mcap_file import write_mcap
from app.sessions.export.mf4_file import write_mf4
from app.sessions.export.parquet_file import write_parquet
from app.sessions.export.table import SignalTable
from app.sessions.reading.reader import SessionFile
from app.words import Message


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

    It appears whole or not at all: an export that is cut off leaves what was there before. `on_progress` is told how
    much of how much is read.

    Raises:
        ConfigError: there is no such format, nothing for it, or no such names in it.
        UnknownSignal: a name means nothing.
        ExportUnavailable: the format needs a package that is not installed.
        OSError: the file cannot be written.
    """
    if export_format not in FORMATS:
        raise ConfigError("format", export_format, Message("one-of", choices=tuple(FORMATS)))
    known = NAMES if FORMATS[export_format].has_names else NAMES[:1]
    if names not in known:
        raise ConfigError("names", names, Message("one-of", choices=known))
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
