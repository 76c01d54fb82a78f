"""Finds the columns that a profile names, and guesses a profile for a header that nobody has described."""

import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from app.errors import ImportFailed
from app.sources.recordings.profile import UNITS, ImportProfile

FloatArray = NDArray[np.float64]
_UNIT = re.compile(r"[\[(]\s*([^\])]+?)\s*[\])]\s*$|[_ ](V|mV|A|mA|degC|C|K|s|ms)$")
_TIME = re.compile(r"time|seconds|\bt\b", re.IGNORECASE)
_CURRENT = re.compile(r"current|\bi\b|amp", re.IGNORECASE)
_VOLTAGE = re.compile(r"cell|volt|\bv|vcell|\bu\d", re.IGNORECASE)
_TEMPERATURE = re.compile(r"temp|therm|ntc|degc|°c", re.IGNORECASE)
_SOC = re.compile(r"\bsoc\b|state.?of.?charge", re.IGNORECASE)
_PLACE = {"n": r"(?P<n>\d+)", "p": r"(?P<p>\d+)"}


@dataclass(frozen=True, slots=True)
class Table:
    """Columns of numbers: (n,) each, NaN where empty."""

    source: str
    columns: Mapping[str, FloatArray]

    def column(self, what: str, name: str) -> FloatArray:
        """Return one column by its name, or by its number from 1.

        Raises:
            ImportFailed: there is no such column.
        """
        if name in self.columns:
            return self.columns[name]
        if name.isdigit() and 1 <= int(name) <= len(self.columns):
            return list(self.columns.values())[int(name) - 1]
        raise ImportFailed(self.source, f"{what} = {name!r}: no such column; there are {_some(list(self.columns))}")

    def matrix(self, what: str, pattern: str) -> FloatArray:
        """Return the columns of a pattern as (n, k), in the order of pack and number.

        Raises:
            ImportFailed: no column fits the pattern.
        """
        found = matching(pattern, list(self.columns))
        if not found:
            raise ImportFailed(
                self.source, f"{what} = {pattern!r}: no column fits; there are {_some(list(self.columns))}"
            )
        return np.column_stack([self.columns[name] for name in found])


def matching(pattern: str, names: Sequence[str]) -> list[str]:
    """Return the names that a pattern with {n}, and {p}, stands for, in the order of pack and number."""
    parts = re.split(r"\{([np])\}", pattern)
    expression = "".join(_PLACE[part] if i % 2 else re.escape(part) for i, part in enumerate(parts))
    try:
        found = [(match.groupdict(), name) for name in names if (match := re.fullmatch(expression, name))]
    except re.error:
        return []
    found.sort(key=lambda each: (int(each[0].get("p") or 0), int(each[0].get("n") or 0)))
    return [name for _, name in found]


def guess(table: Table) -> ImportProfile:
    """Return the profile that the names and numbers suggest; what is not clear is left empty."""
    names = list(table.columns)
    groups: dict[str, list[str]] = defaultdict(list)
    for name in names:
        digits = re.findall(r"\d+", name)
        if digits:
            marks = iter(["{p}", "{n}"] if len(digits) == 2 else ["{n}"] * len(digits))
            groups[re.sub(r"\d+", lambda _: next(marks), name)].append(name)  # noqa: B023  used at once
    profile = ImportProfile()
    many = sorted((g for g in groups.items() if len(g[1]) > 1), key=lambda g: -len(g[1]))
    for pattern, members in many:
        median = _median(np.concatenate([table.columns[name] for name in members]))
        if not profile.temperatures and _TEMPERATURE.search(pattern) and -60 < median < 400:
            unit = "K" if median > 200 else "degC"
            profile = replace(profile, temperatures=pattern, temperature_unit=unit)
        elif not profile.voltages and _VOLTAGE.search(pattern) and (unit := _voltage_unit(median)):
            profile = replace(profile, voltages=pattern, voltage_unit=unit)
    single = [name for name in names if not matching(profile.voltages, [name])]
    time = next((name for name in single if _TIME.search(name)), "")
    current = next((name for name in single if _CURRENT.search(name) and name != time), "")
    soc = next((name for name in single if _SOC.search(name)), "")
    if soc:
        profile = replace(profile, soc_unit="percent" if _median(table.columns[soc]) > 1.5 else "fraction")
    return replace(
        profile,
        time=time,
        time_unit=_unit(time, "time", "s"),
        current=current,
        current_unit=_unit(current, "current", "A"),
        soc=soc,
    )


def _voltage_unit(median: float) -> str:
    for unit, low in (("V", 1.5), ("mV", 1500.0), ("0.1mV", 15000.0)):
        if low < median < low * 10 / 3:
            return unit
    return ""


def _unit(name: str, quantity: str, default: str) -> str:
    match = _UNIT.search(name)
    text = (match[1] or match[2]) if match else ""
    return text if text in UNITS[quantity] else default


def _median(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else float("nan")


def _some(names: list[str]) -> str:
    shown = ", ".join(repr(name) for name in names[:12])
    return shown + (f" and {len(names) - 12} more" if len(names) > 12 else "")
