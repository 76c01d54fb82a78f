"""The export formats by name, and what they are; what writes them is in `export`."""

from dataclasses import dataclass
from typing import Literal, get_args

Names = Literal["index", "number", "pack"]
NAMES: tuple[Names, ...] = get_args(Names)
WITH_NAMES = ("csv", "parquet", "mf4", "ld", "ldx", "motec")  # formats whose signals can be called otherwise
WITH_LAPS = ("mf4", "ld", "ldx", "motec")  # formats that hold them


@dataclass(frozen=True, slots=True)
class Format:
    """A file format: how it is named and served."""

    suffix: str
    media_type: str
    meaning: str


FORMATS = {
    "csv": Format(".csv", "text/csv", "comma-separated values"),
    "parquet": Format(".parquet", "application/vnd.apache.parquet", "Apache Parquet (needs pyarrow)"),
    "mcap": Format(".mcap", "application/octet-stream", "MCAP, for Foxglove and Lichtblick (needs mcap, protobuf)"),
    "mf4": Format(".mf4", "application/octet-stream", "ASAM MDF 4 (needs asammdf)"),
    "ld": Format(".ld", "application/octet-stream", "MoTeC i2, resampled; laps beside it as .ldx"),
    "motec": Format(".zip", "application/zip", "MoTeC i2: the .ld and its .ldx in one zip"),
    "ldx": Format(".ldx", "application/xml", "MoTeC i2: the laps, to lie beside an .ld of its name"),
    "candump": Format(".log", "text/plain", "the CAN frames as candump -L writes them"),
    "asc": Format(".asc", "text/plain", "the CAN frames as Vector ASC"),
    "blf": Format(".blf", "application/octet-stream", "the CAN frames as Vector BLF"),
}
