"""The parsed TOML of a cell file: takes typed values out of it and knows on which line each of them stands."""

from __future__ import annotations

import re
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from app.estimation.cell_model.circuit import MAX_RC_PAIRS
from app.estimation.cell_model.surface import NUMBERS, ROWS
from app.estimation.errors import CellFileError

MOST_POINTS: Final = 10_000  # points of a table over SOC and temperature
_TOP: Final = {"name", "source", "capacity_ah", "coulombic_efficiency", "v_min_v", "v_max_v", "v_nominal_v", "mass_kg"}
SECTIONS: Final = {
    "ocv": {"method", "soc", "voltage_v"},
    "circuit": {"soc", "temperature_degc", "r0_ohm", "ocv_shift_v", "rc"},
    "asinh": {"current_a", "voltage_v"},
    "hysteresis": {"voltage_v", "rate"},
    "surface": {*NUMBERS, *ROWS, "lag"},
    "sigma": {*NUMBERS, "tau_s", "soc_per_a", "r_ohm", "correction", "entropy_v_k"},
    "errors": {"degc", "degc_v", "soc", "soc_v", "current_c", "current_v"},
    "fit": {
        "voltage_rms_v",
        "current_max_a",
        "temperature_degc",
        "activation_sigma_j_mol",
        "soc",
        "has_ocv",
        "lowest_degc",
        "lowest_soc",
        "held_s",
        "held_a",
    },
    "limits": {"temperature_min_degc", "temperature_max_degc", "discharge_max_a", "charge_max_a"},
}


class CellDocument:
    """Takes typed values out of a parsed document and knows on which line each of them stands."""

    def __init__(self, document: dict[str, Any], text: str, path: str) -> None:
        self._document = document
        self._lines = text.splitlines()
        self._path = path

    def refuse_unknown(self) -> None:
        """Refuse fields and sections that no cell file has."""
        for key, value in self._document.items():
            if key not in _TOP | set(SECTIONS):
                raise self._error("", key, "is not a field of a cell file")
            if key in SECTIONS and not isinstance(value, dict):
                raise self._error("", key, "has to be a section")
            for inner in value if key in SECTIONS else ():
                if inner not in SECTIONS[key]:
                    raise self._error(key, inner, "is not a field of this section")

    def refuse_alone(self, section: str, key: str, needed: str) -> None:
        """Refuse a field that says nothing without another."""
        if key in self._section(section) and needed not in self._section(section):
            raise self._error(section, needed, f"is missing where {key} is given")

    def refuse_both(self, section: str, other: str) -> None:
        """Refuse two sections that say the same."""
        if section in self._document and other in self._document:
            raise self._error("", other, f"and [{section}] say the same: one of them")

    def listed(self, section: str, name: str, keys: tuple[str, ...]) -> range:
        """Return the numbers of the RC pairs, or of the lags, in a section."""
        tables = self._section(section).get(name, [])
        if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
            raise self._error(section, name, f"has to be a list of [[{section}.{name}]] sections")
        if len(tables) > MAX_RC_PAIRS:
            field = f"{section}.{name}[{MAX_RC_PAIRS}]"
            raise self._error(field, "r_ohm", f"is one of {len(tables)}; 0 to {MAX_RC_PAIRS} are possible")
        for k, table in enumerate(tables):
            for key in table:
                if key not in keys:
                    raise self._error(f"{section}.{name}[{k}]", key, "is not a field of this section")
        return range(len(tables))

    def take(self, section: str, key: str, kind: type | tuple[type, ...], default: Any = None) -> Any:
        """Return the value of a field that has to be of the kind."""
        value = self._section(section).get(key, default)
        if value is None:
            raise self._error(section, key, "is missing")
        if not isinstance(value, kind) or isinstance(value, bool):
            raise self._error(section, key, f"has the wrong type ({type(value).__name__})")
        return value

    def number(self, section: str, key: str, default: float | None = None) -> float:
        """Return a field as a number."""
        value = self.take(section, key, (int, float), default)
        try:
            return float(value)
        except OverflowError as exc:
            raise self._error(section, key, "is too large") from exc

    def has(self, section: str, key: str) -> bool:
        """Return whether a field is given."""
        return key in self._section(section)

    def number_or_none(self, section: str, key: str) -> float | None:
        """Return a field as a number, None where it is not given."""
        return self.number(section, key) if self.has(section, key) else None

    def word(self, section: str, key: str) -> Any:
        """Return a field as text."""
        return self.take(section, key, str, "interpolation")

    def row(self, section: str, key: str, default: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
        """Return a field as a row of numbers."""
        value = self.take(section, key, (list, np.ndarray), default)
        return self._array(section, key, value, 1)

    def check_points(self, temperatures: int, socs: int) -> None:
        """Refuse grids of more points than a table is made for."""
        if temperatures * socs > MOST_POINTS:
            reason = f"{socs} values, with {temperatures} temperatures; at most {MOST_POINTS} points"
            raise self._error("circuit", "soc", reason)

    def table(
        self, section: str, key: str, shape: tuple[int, int], default: float | None = None
    ) -> NDArray[np.float64]:
        """A single number, one row over SOC, or one row for each temperature."""
        value = self.take(section, key, (list, int, float), default)
        array = self._array(section, key, value, 2)
        try:
            return np.array(np.broadcast_to(array, shape))
        except ValueError as exc:
            raise self._error(section, key, f"has shape {array.shape}, the grids ask for {shape}") from exc

    def line_of(self, field: str) -> int | None:
        """Return the line of a field written with its section, None if unknown."""
        section, _, key = field.rpartition(".")
        return self._line(section, key)

    def _section(self, section: str) -> dict[str, Any]:
        at: Any = self._document
        for part in section.split(".") if section else ():
            name, _, index = part.partition("[")
            at = at.get(name, {})
            if index:
                at = at[int(index[:-1])]
        return at if isinstance(at, dict) else {}

    def _array(self, section: str, key: str, value: Any, ndim: int) -> NDArray[np.float64]:
        try:
            array = np.array(value, dtype=np.float64)
            is_truth = np.array(value).dtype == np.bool_
        except (ValueError, TypeError, OverflowError) as exc:
            raise self._error(section, key, "has to hold numbers, every row as long as the first") from exc
        if is_truth:
            raise self._error(section, key, "has to hold numbers, not true and false")
        if array.ndim > ndim or array.size == 0:
            raise self._error(section, key, f"has {array.ndim} dimensions and {array.size} numbers")
        return array

    def _error(self, section: str, key: str, reason: str) -> CellFileError:
        field = f"{section}.{key}" if section else key
        return CellFileError(self._path, self._line(section, key), field, reason)

    def _line(self, section: str, key: str) -> int | None:
        """The line of the field; else of its section; else None (the field is missing at the top)."""
        name, _, index = section.partition("[")
        header = re.compile(r"\s*\[\[?\s*" + re.escape(name) + r"\s*\]\]?\s*(#|$)")
        other = re.compile(r"\s*\[\[?[\w.]+\]\]?\s*(#|$)")
        if not section:
            named = re.compile(r"\s*\[\[?\s*" + re.escape(key) + r"\s*\]\]?\s*(#|$)")
            for number, line in enumerate(self._lines, 1):
                if named.match(line):
                    return number
        start, skip = (0, 0) if not section else (None, int(index[:-1]) if index else 0)
        for number, line in enumerate(self._lines, 1):
            if section and header.match(line):
                start, skip = (number, skip) if skip == 0 else (None, skip - 1)
            elif start is not None and other.match(line):
                break
            elif start is not None and re.match(rf"\s*{re.escape(key)}\s*=", line):
                return number
        return start or None
