"""The export formats by name."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from app.errors import ConfigError
from app.sessions.export.can_log import write_asc, write_blf, write_candump
from app.sessions.export.csv_file import csv_parts
from app.sessions.export.ld_file import write_ld, write_ldx, write_motec
from app.sessions.export.mcap_file import write_mcap
from app.sessions.export.mf4_file import write_mf4
from app.sessions.export.names import NAMES, Names
from app.sessions.export.parquet_file import write_parquet
from app.sessions.export.table import SignalTable
from app.sessions.reading.reader import SessionFile
from app.words import Message


@dataclass(frozen=True, slots=True)
class Format:
    """A file format: how it is named, served and written."""

    suffix: str
    media_type: str
    meaning: str
    write: Callable[[SignalTable, Path], None]


def write_csv(table: SignalTable, path: Path) -> None:
    """Write the file."""
    with path.open("wb") as file:
        for part in csv_parts(table):
            file.write(part)


WITH_NAMES = ("csv", "parquet", "mf4", "ld", "ldx", "motec")  # formats whose signals can be called otherwise
WITH_LAPS = ("mf4", "ld", "ldx", "motec")  # formats that hold them
FORMATS = {
    "csv": Format(".csv", "text/csv", "comma-separated values", write_csv),
    "parquet": Format(".parquet", "application/vnd.apache.parquet", "Apache Parquet (needs pyarrow)", write_parquet),
    "mcap": Format(
        ".mcap", "application/octet-stream", "MCAP, for Foxglove and Lichtblick (needs mcap, protobuf)", write_mcap
    ),
    "mf4": Format(".mf4", "application/octet-stream", "ASAM MDF 4 (needs asammdf)", write_mf4),
    "ld": Format(".ld", "application/octet-stream", "MoTeC i2, resampled; laps beside it as .ldx", write_ld),
    "motec": Format(".zip", "application/zip", "MoTeC i2: the .ld and its .ldx in one zip", write_motec),
    "ldx": Format(".ldx", "application/xml", "MoTeC i2: the laps, to lie beside an .ld of its name", write_ldx),
    "candump": Format(".log", "text/plain", "the CAN frames as candump -L writes them", write_candump),
    "asc": Format(".asc", "text/plain", "the CAN frames as Vector ASC", write_asc),
    "blf": Format(".blf", "application/octet-stream", "the CAN frames as Vector BLF", write_blf),
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
) -> None:
    """Write signals of a range, both ends in unix time and included, as a file.

    It appears whole or not at all: an export that is cut off leaves what was there before.

    Raises:
        ConfigError: there is no such format, nothing for it, or no such names in it.
        UnknownSignal: a name means nothing.
        ExportUnavailable: the format needs a package that is not installed.
        OSError: the file cannot be written.
    """
    if export_format not in FORMATS:
        raise ConfigError("format", export_format, Message("one-of", choices=tuple(FORMATS)))
    known = NAMES if export_format in WITH_NAMES else NAMES[:1]
    if names not in known:
        raise ConfigError("names", names, Message("one-of", choices=known))
    table = SignalTable(session, signals, t_from_s, t_to_s, lap_times_s=lap_times_s, names=names)
    if path.exists() and not path.is_file():  # a device or a pipe
        FORMATS[export_format].write(table, path)
        return
    part = path.with_name(f".part-{path.name}")
    try:
        FORMATS[export_format].write(table, part)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
