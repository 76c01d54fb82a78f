"""The export formats by name, and what they are; what writes them is in `export`.

The command line, OpenAPI and the page (`frontend/src/generated/export_formats.ts`) have them from here.
"""

from dataclasses import dataclass
from typing import Final, Literal, get_args

Names = Literal["index", "number", "pack"]
NAMES: tuple[Names, ...] = get_args(Names)


@dataclass(frozen=True, slots=True)
class Format:
    """A file format.

    Attributes:
        suffix: ending of its files.
        media_type: of the answer that carries it.
        name: for people.
        meaning: what it holds, and for which program.
        needs: packages that are not in every installation.
        has_signals: it holds chosen signals, else all CAN frames.
        has_names: its signals can be called otherwise than by their index.
        has_laps: it holds the laps.
        is_part: it is one of two files that belong together, offered on the command line alone.
    """

    suffix: str
    media_type: str
    name: str
    meaning: str
    needs: tuple[str, ...] = ()
    has_signals: bool = True
    has_names: bool = True
    has_laps: bool = False
    is_part: bool = False


_BYTES: Final = "application/octet-stream"
_CSV: Final = "a line for every sample, units in the names"
_PARQUET, _ARROW = "for pandas, Polars, DuckDB", "application/vnd.apache.parquet"
_MCAP: Final = ("mcap", "protobuf")
_MOTEC: Final = "for i2: .ld at one rate and .ldx with the laps, zipped"
_LDX: Final = "for i2: the laps of an .ld of its name"
FORMATS: Final = {
    "csv": Format(".csv", "text/csv", "CSV", _CSV),
    "parquet": Format(".parquet", _ARROW, "Parquet", _PARQUET, ("pyarrow",)),
    "mf4": Format(".mf4", _BYTES, "MDF 4", "ASAM, for CANape, asammdf", ("asammdf",), has_laps=True),
    "mcap": Format(".mcap", _BYTES, "MCAP", "for Foxglove and Lichtblick", _MCAP, has_names=False),
    "motec": Format(".zip", "application/zip", "MoTeC", _MOTEC, has_laps=True),
    "ld": Format(".ld", _BYTES, "MoTeC", "for i2: one rate; laps in an .ldx", has_laps=True, is_part=True),
    "ldx": Format(".ldx", "application/xml", "MoTeC", _LDX, has_laps=True, is_part=True),
    "candump": Format(".log", "text/plain", "candump", "the CAN frames as text", has_signals=False, has_names=False),
    "asc": Format(
        ".asc", "text/plain", "Vector ASC", "the CAN frames for CANalyzer", has_signals=False, has_names=False
    ),
    "blf": Format(".blf", _BYTES, "Vector BLF", "the CAN frames, binary", has_signals=False, has_names=False),
}
