"""Cell files: a cell model as TOML that people can read, write and compare.

The only place of the package that touches a file. A cell that ships with Voltwall is loaded by its bare name.
"""

from __future__ import annotations

import re
import tomllib
from importlib import resources
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from app.estimation.circuit import CellLimits, CellModel
from app.estimation.errors import CellFileError, ModelError
from app.estimation.ocv import OcvCurve

DEFAULT_CELL: Final = "samsung-25r-10p"
_TOP: Final = {"name", "source", "capacity_ah", "coulombic_efficiency", "v_min_v", "v_max_v"}
_SECTIONS: Final = {
    "ocv": {"method", "soc", "voltage_v"},
    "circuit": {"soc", "temperature_degc", "r0_ohm", "rc"},
    "asinh": {"current_a", "voltage_v"},
    "hysteresis": {"voltage_v", "rate"},
    "fit": {"voltage_rms_v", "current_max_a"},
    "limits": {"temperature_min_degc", "temperature_max_degc", "discharge_max_a", "charge_max_a"},
}
_FIELD_OF_ATTRIBUTE: Final = {
    "soc_grid": "circuit.soc",
    "temperature_grid_degc": "circuit.temperature_degc",
    "r0_ohm": "circuit.r0_ohm",
    "r_ohm": "circuit.rc.r_ohm",
    "tau_s": "circuit.rc.tau_s",
    "overpotential_v": "asinh.voltage_v",
    "overpotential_current_a": "asinh.current_a",
    "hysteresis_v": "hysteresis.voltage_v",
    "hysteresis_rate": "hysteresis.rate",
    "fit_voltage_rms_v": "fit.voltage_rms_v",
    "fit_current_max_a": "fit.current_max_a",
    "ocv": "ocv.voltage_v",
}


def bundled_cells() -> tuple[str, ...]:
    """Return the names of the cells that ship with Voltwall, in order."""
    folder = resources.files("app.estimation") / "cells"
    return tuple(sorted(f.name.removesuffix(".toml") for f in folder.iterdir() if f.name.endswith(".toml")))


def load_cell(path_or_name: str | Path = DEFAULT_CELL) -> CellModel:
    """Return the cell model of a TOML file, or of a bundled cell when the argument is one of their names.

    Raises:
        CellFileError: the file cannot be read, is not TOML, or a field is missing, unknown, of the wrong type,
            of the wrong shape or out of range; the error names the line and the field.
    """
    name = str(path_or_name)
    path = Path(name)
    try:
        if name in bundled_cells():
            text = (resources.files("app.estimation") / "cells" / f"{name}.toml").read_text(encoding="utf-8")
        else:
            text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as exc:
        reason = f"cannot be read ({exc}); bundled cells: {', '.join(bundled_cells())}"
        raise CellFileError(name, None, "", reason) from exc
    return parse_cell(text, name)


def parse_cell(text: str, path: str = "cell file") -> CellModel:
    """Return the cell model written in TOML text; `path` is for the error message only.

    Raises:
        CellFileError: see `load_cell`.
    """
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as exc:
        found = re.search(r"line (\d+)", str(exc))
        raise CellFileError(path, int(found.group(1)) if found else None, "", f"not TOML: {exc}") from exc
    reader = _Reader(document, text, path)
    reader.refuse_unknown()
    try:
        ocv = OcvCurve(reader.row("ocv", "soc"), reader.row("ocv", "voltage_v"), reader.word("ocv", "method"))
        soc = reader.row("circuit", "soc", np.array([0.5]))
        temperature = reader.row("circuit", "temperature_degc", np.array([25.0]))
        shape = (temperature.size, soc.size)
        pairs = reader.pairs()
        return CellModel(
            name=str(reader.take("", "name", str)),
            source=str(reader.take("", "source", str, "")),
            capacity_ah=reader.number("", "capacity_ah"),
            coulombic_efficiency=reader.number("", "coulombic_efficiency", 1.0),
            v_min_v=reader.number("", "v_min_v"),
            v_max_v=reader.number("", "v_max_v"),
            ocv=ocv,
            soc_grid=soc,
            temperature_grid_degc=temperature,
            r0_ohm=reader.table("circuit", "r0_ohm", shape),
            r_ohm=np.array([reader.table(f"circuit.rc[{k}]", "r_ohm", shape) for k in pairs]).reshape(-1, *shape),
            tau_s=np.array([reader.table(f"circuit.rc[{k}]", "tau_s", shape) for k in pairs]).reshape(-1, *shape),
            overpotential_v=reader.table("asinh", "voltage_v", shape, 0.0),
            overpotential_current_a=reader.number("asinh", "current_a", 1.0),
            hysteresis_v=reader.number("hysteresis", "voltage_v", 0.0),
            hysteresis_rate=reader.number("hysteresis", "rate", 50.0),
            fit_voltage_rms_v=reader.number("fit", "voltage_rms_v", 0.0),
            fit_current_max_a=reader.number("fit", "current_max_a", 0.0),
            limits=CellLimits(**{name: reader.known("limits", name) for name in sorted(_SECTIONS["limits"])}),
        )
    except CellFileError:
        raise
    except ModelError as exc:
        field = _FIELD_OF_ATTRIBUTE.get(exc.field, exc.field)
        raise CellFileError(path, reader.line_of(field), field, exc.reason) from exc


def save_cell(model: CellModel, path: str | Path) -> None:
    """Write the model as a cell file that `load_cell` reads back equal to 9 digits; OSError if it cannot."""
    Path(path).write_text(format_cell(model), encoding="utf-8")


def format_cell(model: CellModel) -> str:
    """Return the model as TOML text."""
    lines = [
        f"name = {_quote(model.name)}",
        f"source = {_quote(model.source)}",
        f"capacity_ah = {_number(model.capacity_ah)}",
        f"coulombic_efficiency = {_number(model.coulombic_efficiency)}",
        f"v_min_v = {_number(model.v_min_v)}",
        f"v_max_v = {_number(model.v_max_v)}",
        "",
        "[ocv]",
        f'method = "{model.ocv.method}"',
        f"soc = {_row(model.ocv.soc)}",
        f"voltage_v = {_row(model.ocv.voltage_v)}",
        "",
        "[circuit]  # tables: one row for each temperature, one column for each SOC",
        f"soc = {_row(model.soc_grid)}",
        f"temperature_degc = {_row(model.temperature_grid_degc)}",
        f"r0_ohm = {_table(model.r0_ohm)}",
    ]
    for r, tau in zip(model.r_ohm, model.tau_s, strict=True):
        lines += ["", "[[circuit.rc]]", f"r_ohm = {_table(r)}", f"tau_s = {_table(tau)}"]
    if model.overpotential_v is not None and model.overpotential_v.any():
        lines += ["", "[asinh]", f"current_a = {_number(model.overpotential_current_a)}"]
        lines.append(f"voltage_v = {_table(model.overpotential_v)}")
    if model.hysteresis_v:
        lines += ["", "[hysteresis]", f"voltage_v = {_number(model.hysteresis_v)}"]
        lines.append(f"rate = {_number(model.hysteresis_rate)}")
    lines += ["", "[fit]", f"voltage_rms_v = {_number(model.fit_voltage_rms_v)}"]
    lines.append(f"current_max_a = {_number(model.fit_current_max_a)}")
    limits = {name: getattr(model.limits, name) for name in sorted(_SECTIONS["limits"])}
    if known := [f"{name} = {_number(value)}" for name, value in limits.items() if value is not None]:
        lines += ["", "[limits]  # of the data sheet", *known]
    return "\n".join(lines) + "\n"


class _Reader:
    """Takes typed values out of a parsed document and knows on which line each of them stands."""

    def __init__(self, document: dict[str, Any], text: str, path: str) -> None:
        self._document = document
        self._lines = text.splitlines()
        self._path = path

    def refuse_unknown(self) -> None:
        for key, value in self._document.items():
            if key not in _TOP | set(_SECTIONS):
                raise self._error("", key, "is not a field of a cell file")
            if key in _SECTIONS and not isinstance(value, dict):
                raise self._error("", key, "has to be a section")
            for inner in value if key in _SECTIONS else ():
                if inner not in _SECTIONS[key]:
                    raise self._error(key, inner, "is not a field of this section")

    def pairs(self) -> range:
        rc = self._section("circuit").get("rc", [])
        if not isinstance(rc, list) or not all(isinstance(pair, dict) for pair in rc):
            raise self._error("circuit", "rc", "has to be a list of [[circuit.rc]] sections")
        for k, pair in enumerate(rc):
            for key in pair:
                if key not in ("r_ohm", "tau_s"):
                    raise self._error(f"circuit.rc[{k}]", key, "is not a field of this section")
        return range(len(rc))

    def take(self, section: str, key: str, kind: type | tuple[type, ...], default: Any = None) -> Any:
        value = self._section(section).get(key, default)
        if value is None:
            raise self._error(section, key, "is missing")
        if not isinstance(value, kind) or isinstance(value, bool):
            raise self._error(section, key, f"has the wrong type ({type(value).__name__})")
        return value

    def number(self, section: str, key: str, default: float | None = None) -> float:
        return float(self.take(section, key, (int, float), default))

    def known(self, section: str, key: str) -> float | None:
        return self.number(section, key) if key in self._section(section) else None

    def word(self, section: str, key: str) -> Any:
        return self.take(section, key, str, "interpolation")

    def row(self, section: str, key: str, default: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
        value = self.take(section, key, (list, np.ndarray), default)
        return self._array(section, key, value, 1)

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
        except (ValueError, TypeError) as exc:
            raise self._error(section, key, "has to hold numbers, every row as long as the first") from exc
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


def _quote(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n").replace("\t", "\\t")
    return f'"{escaped}"'


def _number(value: float) -> str:
    text = f"{float(value):.9g}"
    return text if any(mark in text for mark in ".en") else text + ".0"


def _row(values: NDArray[np.float64]) -> str:
    return "[" + ", ".join(_number(v) for v in values) + "]"


def _table(table: NDArray[np.float64]) -> str:
    if np.ptp(table) == 0.0:
        return _number(table.flat[0])
    return "[\n" + "".join(f"  {_row(row)},\n" for row in table) + "]"
