"""The columns of another program's recording: mapped once, kept as TOML, used for every file of that kind.

A pattern stands for many columns: `Cell {n} Voltage`, with several packs `Pack{p}_Cell{n}_V`; columns are taken in
the order of pack and number. In a CAN log names are signals of the DBC, also as Message.Signal; one signal whose cell
another signal of the same message tells is `CellVoltage[CellID]`.
"""

import json
import re
from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields
from pathlib import Path

from app.errors import ImportFailed, unknown_name
from app.estimation.recording.means_choices import CHOICES
from app.estimation.toml_text import TomlError, read_toml
from app.sources.data_file import replace_file
from app.sources.recordings.bad_rows import some_of
from app.sources.recordings.quantities import UNITS
from app.words import Message

EXPORT_TIMES = ("time_s", "elapsed_s", "uptime_s")  # the first columns of a table that is exported
EXPORT_STAMP = "time"  # and its last, a UTC time stamp to the microsecond; earlier tables have none
_CELLS = re.compile(r"(\d{1,4})(?:-(\d{1,4}))?", re.ASCII)
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9 ._-]{0,59}")


@dataclass(frozen=True, slots=True)
class ImportMapping:
    """The column of each quantity; an empty text is: not there."""

    time: str = ""
    time_unit: str = "s"  # empty: not clear, to be chosen
    current: str = ""
    current_unit: str = "A"
    charge_positive: bool = False  # the file counts charging current as positive
    current_means: str = "auto"  # currents are means over each row, voltages instants; auto: as the data show
    voltages: str = ""
    voltage_unit: str = "V"
    cells: str = ""  # which of the matching columns are cells: "1-12,14"; empty: all
    cells_in_series: float = 1.0  # that one voltage column is measured over: each of them takes its share
    temperatures: str = ""
    temperature_unit: str = "degC"
    soc: str = ""  # column of the other system's SOC
    soc_unit: str = "percent"
    max_rate_hz: float = 0.0  # rows that come quicker are left out, and counted; 0 keeps every one
    hold_s: float = 2.0  # CAN: how long a signal counts after its frame
    bus: str = ""  # CAN: which bus of the log is read, as the log names it; empty: all, where no id is on two

    def __post_init__(self) -> None:
        """Check units and numbers.

        Raises:
            ImportFailed: names the field and what it may be.
        """
        for quantity, units in UNITS.items():
            unit = getattr(self, f"{quantity}_unit")
            if unit not in units and (unit or quantity != "time"):
                raise ImportFailed(
                    "profile", Message("no-such-unit", field=f"{quantity}_unit", unit=repr(unit), units=tuple(units))
                )
        if self.current_means not in CHOICES:
            value = repr(self.current_means)
            raise ImportFailed(
                "profile", Message("no-such-choice", field="current_means", value=value, choices=CHOICES)
            )
        for name, limit in (("max_rate_hz", 1000.0), ("hold_s", 600.0), ("cells_in_series", 1000.0)):
            if not (1.0 if name == "cells_in_series" else 0.0) <= getattr(self, name) <= limit:
                value = str(getattr(self, name))
                raise ImportFailed("profile", Message("beyond-range", field=name, value=value, limit=limit))
        parse_cells(self.cells)

    def check_complete(self, source: str, names: Iterable[str]) -> None:
        """Refuse a profile that names too little.

        Args:
            source: the file that it is for, for the error.
            names: of the columns or signals that there are.

        Raises:
            ImportFailed: it says which quantity is missing.
        """
        for name in ("current", "voltages"):
            if not getattr(self, name):
                raise ImportFailed(source, Message("not-named", field=name, names=some_of(list(names))))


def parse_cells(text: str) -> list[tuple[int, int]]:
    """Return the first and last number, from 1, of each span in a text like `1-12, 14`.

    Raises:
        ImportFailed: it is something else.
    """
    spans = []
    for part in "".join(text.split()).split(",") if text.strip() else []:
        match = _CELLS.fullmatch(part)
        first, last = (int(match[1]), int(match[2] or match[1])) if match is not None else (0, 0)
        if not 1 <= first <= last:
            raise ImportFailed("profile", Message("no-cell-numbers", value=repr(text[:60])))
        spans.append((first, last))
    return spans


def parse_mapping(text: str, source: str = "profile") -> ImportMapping:
    """Return the profile in a TOML text.

    Raises:
        ImportFailed: it is no TOML, or a field is unknown or of the wrong kind.
    """
    try:
        return mapping_of(read_toml(text), source)
    except TomlError as error:
        raise ImportFailed(source, Message("no-toml", error=str(error))) from error


def mapping_of(given: dict[str, object], source: str = "profile") -> ImportMapping:
    """Return the profile of named values.

    Raises:
        ImportFailed: a field is unknown or of the wrong kind.
    """
    kinds = {field.name: type(field.default) for field in fields(ImportMapping)}
    for name, value in given.items():
        if name not in kinds:
            raise ImportFailed(source, Message("no-profile-field", field=name, fields=tuple(kinds)))
        is_number = kinds[name] is float and isinstance(value, int | float) and not isinstance(value, bool)
        if not is_number and not isinstance(value, kinds[name]):
            raise ImportFailed(source, Message("wrong-kind", field=name, value=repr(value), kind=kinds[name].__name__))
    return ImportMapping(**given)  # type: ignore[arg-type]


def mapping_text(mapping: ImportMapping) -> str:
    """Return the profile as TOML."""
    text = "".join(f"{name} = {json.dumps(value, ensure_ascii=False)}\n" for name, value in asdict(mapping).items())
    return text.replace("\x7f", "\\u007f")  # TOML has no bare DEL


class ImportMappingStore:
    """Profiles by name in a folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def names(self) -> list[str]:
        """All of them, by name."""
        return sorted(path.stem for path in self._folder.glob("*.toml")) if self._folder.is_dir() else []

    def load(self, name: str) -> ImportMapping:
        """Return a profile.

        Raises:
            ImportFailed: there is none of this name, or it cannot be read.
        """
        path = self._path(name)
        if not path.is_file():
            raise ImportFailed(name, unknown_name(name, self.names()) if self.names() else Message("no-profile-yet"))
        return parse_mapping(path.read_text(encoding="utf-8"), str(path))

    def save(self, name: str, mapping: ImportMapping) -> None:
        """Keep a profile under a name, in place of an older one.

        Raises:
            ImportFailed: the name cannot be one.
        """
        path = self._path(name)
        self._folder.mkdir(parents=True, exist_ok=True)
        replace_file(path, mapping_text(mapping).encode())

    def _path(self, name: str) -> Path:
        if not _NAME.fullmatch(name):
            raise ImportFailed("profile", Message("bad-profile-name", name=repr(name[:60])))
        return self._folder / f"{name}.toml"
