"""Which columns of another program's recording are what: written once, kept as TOML, used for every file of that kind.

A pattern stands for many columns: `Cell {n} Voltage`, with several packs `Pack{p}_Cell{n}_V`; columns are taken in
the order of pack and number. In a CAN log names are signals of the DBC, also as Message.Signal; one signal whose cell
another signal of the same message tells is `CellVoltage[CellID]`.
"""

import json
import re
import tomllib
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

import numpy as np

from app.errors import ImportFailed
from app.estimation.arrays import FloatArray
from app.sources.recordings.quantities import UNITS, candidates, sounds_like, unit_of
from app.sources.recordings.table import Table, matching
from app.sources.whole_file import replace_file
from app.words import Message

EXPORT_TIMES = ("time_s", "elapsed_s", "uptime_s")  # the first columns of a table that is exported
EXPORT_STAMP = "time"  # and its last, a UTC time stamp to the microsecond; earlier tables have none
SOC_IN_PERCENT, KELVIN_FROM, MILLIVOLTS_FROM = 1.5, 200.0, 500.0  # medians beyond them
ONE_CELL_BELOW_V, USUAL_CELL_V = 10.0, 3.7  # a higher voltage is that of so many cells in series
SIGN_EVIDENCE = 0.4  # correlation of the steps of voltage and current
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9 ._-]{0,59}")


@dataclass(frozen=True, slots=True)
class ImportProfile:
    """Where each quantity is; an empty text is: not there."""

    time: str = ""
    time_unit: str = "s"
    current: str = ""
    current_unit: str = "A"
    charge_positive: bool = False  # the file counts charging current as positive
    voltages: str = ""
    voltage_unit: str = "V"
    cells_in_series: float = 1.0  # that one voltage column is measured over: each of them takes its share
    temperatures: str = ""
    temperature_unit: str = "degC"
    soc: str = ""  # of the pack, as the other system has it
    soc_unit: str = "percent"
    max_rate_hz: float = 0.0  # rows that come quicker are left out, and counted; 0 keeps every one
    hold_s: float = 2.0  # CAN: how long a signal counts after its frame

    def __post_init__(self) -> None:
        """Check units and numbers.

        Raises:
            ImportFailed: names the field and what it may be.
        """
        for quantity, units in UNITS.items():
            unit = getattr(self, f"{quantity}_unit")
            if unit not in units:
                raise ImportFailed(
                    "profile", Message("no-such-unit", field=f"{quantity}_unit", unit=repr(unit), units=tuple(units))
                )
        for name, limit in (("max_rate_hz", 1000.0), ("hold_s", 600.0), ("cells_in_series", 1000.0)):
            if not (1.0 if name == "cells_in_series" else 0.0) <= getattr(self, name) <= limit:
                value = str(getattr(self, name))
                raise ImportFailed("profile", Message("beyond-range", field=name, value=value, limit=limit))

    def check_complete(self) -> None:
        """Refuse a profile that names too little.

        Raises:
            ImportFailed: it says which quantity is missing.
        """
        for name in ("current", "voltages"):
            if not getattr(self, name):
                raise ImportFailed("profile", Message("not-named", field=name))


def parse_profile(text: str, source: str = "profile") -> ImportProfile:
    """Return the profile in a TOML text.

    Raises:
        ImportFailed: it is no TOML, or a field is unknown or of the wrong kind.
    """
    try:
        return profile_of(tomllib.loads(text), source)
    except tomllib.TOMLDecodeError as error:
        raise ImportFailed(source, Message("no-toml", error=str(error))) from error


def profile_of(given: dict[str, object], source: str = "profile") -> ImportProfile:
    """Return the profile of named values.

    Raises:
        ImportFailed: a field is unknown or of the wrong kind.
    """
    kinds = {each.name: type(each.default) for each in fields(ImportProfile)}
    for name, value in given.items():
        if name not in kinds:
            raise ImportFailed(source, Message("no-profile-field", field=name, fields=tuple(kinds)))
        is_number = kinds[name] is float and isinstance(value, int | float) and not isinstance(value, bool)
        if not is_number and not isinstance(value, kinds[name]):
            raise ImportFailed(source, Message("wrong-kind", field=name, value=repr(value), kind=kinds[name].__name__))
    return ImportProfile(**given)  # type: ignore[arg-type]


def profile_text(profile: ImportProfile) -> str:
    """Return the profile as TOML."""
    text = "".join(f"{name} = {json.dumps(value, ensure_ascii=False)}\n" for name, value in asdict(profile).items())
    return text.replace("\x7f", "\\u007f")  # TOML has no bare DEL


def guess(table: Table) -> ImportProfile:
    """Return the profile that the names and numbers suggest; what is not clear is left empty."""
    names = list(table.columns)
    if tuple(names[: len(EXPORT_TIMES)]) == EXPORT_TIMES:
        return _of_export(names)
    groups: dict[str, list[str]] = defaultdict(list)
    for name in names:
        if re.search(r"\d", name):
            groups[re.sub(r"\d+", "#", name)].append(name)
    profile = ImportProfile()
    many = sorted((each for each in groups.values() if len(each) > 1), key=lambda each: -len(each))
    for members in many:
        pattern = _pattern(members)
        if not pattern:
            continue
        values = np.concatenate([table.columns[name] for name in members])
        median = _median(values[values != 0.0])
        if not profile.temperatures and sounds_like(members[0], "temperature") and -60 < median < 400:
            unit = unit_of(members[0], "temperature") or ("K" if median > KELVIN_FROM else "degC")
            profile = replace(profile, temperatures=pattern, temperature_unit=unit)
        elif not profile.voltages and sounds_like(members[0], "voltage") and (unit := _voltage_unit(median)):
            profile = replace(profile, voltages=pattern, voltage_unit=unit)
    grouped = {name for pattern in (profile.voltages, profile.temperatures) for name in matching(pattern, names)}
    columns = {name: values for name, values in table.columns.items() if name not in grouped}
    best: dict[str, tuple[str, str | None]] = {}
    for quantity in UNITS:
        found = candidates(quantity, columns)
        is_clear = quantity != "voltage" or not found[1:] or found[0].is_plain or found[1].score < found[0].score
        best[quantity] = (found[0].name, found[0].unit) if found and is_clear else ("", None)
        columns.pop(best[quantity][0], None)
    soc, soc_unit = best["soc"]
    if soc:
        soc_unit = soc_unit or ("percent" if _median(table.columns[soc]) > SOC_IN_PERCENT else "fraction")
        profile = replace(profile, soc=soc, soc_unit=soc_unit)
    if not profile.voltages and best["voltage"][0]:
        profile = _of_one_cell(table, profile, best)
    (time, time_unit), (current, current_unit) = best["time"], best["current"]
    profile = replace(profile, time=time, time_unit=time_unit or "s", current=current, current_unit=current_unit or "A")
    return replace(profile, charge_positive=_charges_positive(table, profile))


def _of_one_cell(table: Table, profile: ImportProfile, best: Mapping[str, tuple[str, str | None]]) -> ImportProfile:
    """The profile of a test of one cell, or of a log that has the voltage of all cells together."""
    (voltage, unit), (temperature, degrees) = best["voltage"], best["temperature"]
    median = _median(table.columns[voltage])
    unit = unit or ("mV" if median > MILLIVOLTS_FROM else "V")
    median *= UNITS["voltage"][unit][0]
    in_series = 1.0 if median < ONE_CELL_BELOW_V else float(max(1, round(median / USUAL_CELL_V)))
    if temperature and not profile.temperatures:
        degrees = degrees or ("K" if _median(table.columns[temperature]) > KELVIN_FROM else "degC")
        profile = replace(profile, temperatures=temperature, temperature_unit=degrees)
    return replace(profile, voltages=voltage, voltage_unit=unit, cells_in_series=in_series)


def _charges_positive(table: Table, profile: ImportProfile) -> bool:
    """Whether the voltage rises with the current, from row to row or along a charge: then charging is positive."""
    if not profile.current or not profile.voltages:
        return False
    voltages = table.matrix("voltages", profile.voltages)
    columns = np.column_stack([table.column("current", profile.current), voltages.sum(axis=1)])
    columns = columns[np.isfinite(columns).all(axis=1)]
    steps = np.diff(columns, axis=0)
    together = _alike(steps[:, 0], steps[:, 1])
    if abs(together) < SIGN_EVIDENCE:
        together = _alike(columns[1:, 0], steps[:, 1])
    return together > SIGN_EVIDENCE


def _alike(one: FloatArray, other: FloatArray) -> float:
    """How far two (n,) arrays are each other's multiple, -1..1; 0 where one has nothing in it."""
    size = float(np.linalg.norm(one) * np.linalg.norm(other))
    return float(one @ other) / size if size > 0.0 else 0.0


def _of_export(names: list[str]) -> ImportProfile:
    """The profile of a table that `voltwall export` wrote."""

    def first(*wanted: str) -> str:
        return next((name for name in wanted if matching(name, names)), "")

    return ImportProfile(
        time=first(EXPORT_STAMP, EXPORT_TIMES[0]),
        current=first("i_fs (A)", "i_fc (A)", "i_fs", "i_fc"),
        voltages=first("v[{n}] (V)", "v_{n}", "pack{p}_cell{n}_v", "v_{n} (V)", "pack{p}_cell{n}_v (V)"),
        temperatures=first("t[{n}] (degC)", "t_{n}", "pack{p}_cell{n}_t", "t_{n} (degC)", "pack{p}_cell{n}_t (degC)"),
        soc=first("soc"),
        soc_unit="fraction",
    )


def _pattern(names: list[str]) -> str:
    """The pattern of names that differ in their numbers only; "" where more than two of the numbers differ."""
    parts = [re.split(r"(\d+)", name) for name in names]
    places = list(range(1, len(parts[0]), 2))
    if len(places) > 2:  # `Cell 7 (0.1mV)`: what is the same in all of them stands as it is
        places = [i for i in places if len({each[i] for each in parts}) > 1]
    if len(places) > 2:
        return ""
    marks = dict(zip(places, ("{p}", "{n}")[-len(places) :], strict=True))
    return "".join(marks.get(i, part) for i, part in enumerate(parts[0]))


def _voltage_unit(median: float) -> str:
    for unit, low in (("V", 1.5), ("mV", 1500.0), ("0.1mV", 15000.0)):
        if low < median < low * 10 / 3:
            return unit
    return ""


def _median(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else float("nan")


class ProfileStore:
    """Profiles by name in a folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def names(self) -> list[str]:
        """All of them, by name."""
        return sorted(path.stem for path in self._folder.glob("*.toml")) if self._folder.is_dir() else []

    def load(self, name: str) -> ImportProfile:
        """Return a profile.

        Raises:
            ImportFailed: there is none of this name, or it cannot be read.
        """
        path = self._path(name)
        if not path.is_file():
            raise ImportFailed(name, Message("no-such-profile", names=tuple(self.names()) or Message("none-yet")))
        return parse_profile(path.read_text(encoding="utf-8"), str(path))

    def save(self, name: str, profile: ImportProfile) -> None:
        """Keep a profile under a name, in place of an older one.

        Raises:
            ImportFailed: the name cannot be one.
        """
        path = self._path(name)
        self._folder.mkdir(parents=True, exist_ok=True)
        replace_file(path, profile_text(profile).encode())

    def _path(self, name: str) -> Path:
        if not _NAME.fullmatch(name):
            raise ImportFailed("profile", Message("bad-profile-name", name=repr(name[:60])))
        return self._folder / f"{name}.toml"
