"""Cell files: a cell model as TOML that people can read, write and compare.

The only place of the package that touches a file. A cell that ships with Voltwall is loaded by its bare name.
"""

from __future__ import annotations

import re
from importlib import resources
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from app.estimation.cell_model.cell_document import SECTIONS, CellDocument
from app.estimation.cell_model.circuit import ACTIVATION_SIGMA_J_MOL, CellLimits, CellModel
from app.estimation.cell_model.default_cell import DEFAULT_CELL
from app.estimation.cell_model.evidence import Evidence
from app.estimation.cell_model.ocv import OcvCurve
from app.estimation.cell_model.surface import NUMBERS, ROWS, Lag, SurfaceModel
from app.estimation.errors import CellFileError, ModelError
from app.estimation.toml_text import TomlError, read_toml

_FIELD_OF_ATTRIBUTE: Final = {
    "soc_grid": "circuit.soc",
    "temperature_grid_degc": "circuit.temperature_degc",
    "r0_ohm": "circuit.r0_ohm",
    "overpotential_v": "asinh.voltage_v",
    "overpotential_current_a": "asinh.current_a",
    "hysteresis_v": "hysteresis.voltage_v",
    "hysteresis_rate": "hysteresis.rate",
    "fit_voltage_rms_v": "fit.voltage_rms_v",
    "fit_current_max_a": "fit.current_max_a",
    "fit_temperature_degc": "fit.temperature_degc",
    "activation_sigma_j_mol": "fit.activation_sigma_j_mol",
    "ocv_shift_v": "circuit.ocv_shift_v",
    "ocv": "ocv.voltage_v",
}


def bundled_cells() -> tuple[str, ...]:
    """Return the names of the cells that ship with Voltwall, in order."""
    folder = resources.files(__package__) / "cells"
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
            text = (resources.files(__package__) / "cells" / f"{name}.toml").read_text(encoding="utf-8")
        else:
            text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as exc:
        why = exc.strerror if isinstance(exc, OSError) else exc
        reason = f"cannot be read ({why}). Bundled cells: {', '.join(bundled_cells())}"
        raise CellFileError(name, None, "", reason) from exc
    return parse_cell(text, name)


def parse_cell(text: str, path: str = "cell file") -> CellModel:
    """Return the cell model written in TOML text; `path` is for the error message only.

    Raises:
        CellFileError: see `load_cell`.
    """
    try:
        document = read_toml(text)
    except TomlError as exc:
        if exc.field:
            line = CellDocument({}, text, path).line_of(exc.field)
            raise CellFileError(path, line, exc.field, exc.reason) from exc
        raise CellFileError(path, exc.line, "", f"not TOML: {exc}") from exc
    reader = CellDocument(document, text, path)
    reader.refuse_unknown()
    reader.refuse_alone("asinh", "voltage_v", "current_a")
    reader.refuse_both("surface", "circuit")
    reader.refuse_both("surface", "asinh")
    try:
        ocv = OcvCurve(reader.row("ocv", "soc"), reader.row("ocv", "voltage_v"), reader.word("ocv", "method"))
        surface = _surface(reader) if reader.has("", "surface") else None
        return CellModel(
            name=str(reader.take("", "name", str)),
            source=str(reader.take("", "source", str, "")),
            capacity_ah=reader.number("", "capacity_ah"),
            coulombic_efficiency=reader.number("", "coulombic_efficiency", 1.0),
            v_min_v=reader.number("", "v_min_v"),
            v_max_v=reader.number("", "v_max_v"),
            v_nominal_v=reader.number_or_none("", "v_nominal_v"),
            mass_kg=reader.number_or_none("", "mass_kg"),
            ocv=ocv,
            surface=surface,
            **(_circuit(reader) if surface is None else surface.tables()),
            hysteresis_v=reader.number("hysteresis", "voltage_v", 0.0),
            hysteresis_rate=reader.number("hysteresis", "rate", 50.0),
            fit_voltage_rms_v=reader.number("fit", "voltage_rms_v", 0.0),
            fit_current_max_a=reader.number("fit", "current_max_a", 0.0),
            fit_temperature_degc=reader.row("fit", "temperature_degc")
            if reader.has("fit", "temperature_degc")
            else None,
            activation_sigma_j_mol=reader.number("fit", "activation_sigma_j_mol", ACTIVATION_SIGMA_J_MOL),
            evidence=_evidence(reader) if reader.has("fit", "soc") or reader.has("fit", "has_ocv") else None,
            limits=CellLimits(**{name: reader.number_or_none("limits", name) for name in sorted(SECTIONS["limits"])}),
        )
    except CellFileError:
        raise
    except ModelError as exc:
        field = _FIELD_OF_ATTRIBUTE.get(exc.field, exc.field)
        if pair := re.fullmatch(r"(r_ohm|tau_s)\[(\d)\]", exc.field):
            field = f"circuit.rc[{pair.group(2)}].{pair.group(1)}"
        raise CellFileError(path, reader.line_of(field), field, exc.reason) from exc


def _circuit(reader: CellDocument) -> dict[str, Any]:
    """Return the tables of a file that has tables, by the names of `CellModel`."""
    soc = reader.row("circuit", "soc", np.array([0.5]))
    temperature = reader.row("circuit", "temperature_degc", np.array([25.0]))
    shape = (temperature.size, soc.size)
    reader.check_points(*shape)
    pairs = reader.listed("circuit", "rc", ("r_ohm", "tau_s"))
    has_shift = reader.has("circuit", "ocv_shift_v")
    return {
        "soc_grid": soc,
        "temperature_grid_degc": temperature,
        "r0_ohm": reader.table("circuit", "r0_ohm", shape),
        "r_ohm": np.array([reader.table(f"circuit.rc[{k}]", "r_ohm", shape) for k in pairs]).reshape(-1, *shape),
        "tau_s": np.array([reader.table(f"circuit.rc[{k}]", "tau_s", shape) for k in pairs]).reshape(-1, *shape),
        "overpotential_v": reader.table("asinh", "voltage_v", shape, 0.0),
        "overpotential_current_a": reader.number("asinh", "current_a", 1.0),
        "ocv_shift_v": reader.table("circuit", "ocv_shift_v", shape) if has_shift else None,
    }


def _surface(reader: CellDocument) -> SurfaceModel:
    values: dict[str, Any] = {name: reader.number("surface", name) for name in NUMBERS}
    values |= {name: tuple(reader.row("surface", name).tolist()) for name in ROWS if reader.has("surface", name)}
    lags = [f"surface.lag[{k}]" for k in reader.listed("surface", "lag", Lag._fields)]
    values["lags"] = tuple(Lag(*(reader.number(at, name) for name in Lag._fields)) for at in lags)
    return SurfaceModel(**values)


def _evidence(reader: CellDocument) -> Evidence:
    def pairs(section: str, name: str, of: str) -> tuple[tuple[float, float], ...]:
        if not reader.has(section, name):
            return ()
        at, values = reader.row(section, name), reader.row(section, of)
        return tuple(zip(at.tolist(), values.tolist(), strict=False))

    sigma = tuple(
        (name, reader.number("sigma", name)) for name in sorted(SECTIONS["sigma"]) if reader.has("sigma", name)
    )
    return Evidence(
        has_ocv=bool(reader.number("fit", "has_ocv", 1.0)),
        soc=tuple(reader.row("fit", "soc").tolist()) if reader.has("fit", "soc") else (),
        lowest=pairs("fit", "lowest_degc", "lowest_soc"),
        sigma=sigma,
        by_degc=pairs("errors", "degc", "degc_v"),
        by_soc=pairs("errors", "soc", "soc_v"),
        by_c=pairs("errors", "current_c", "current_v"),
        held=pairs("fit", "held_s", "held_a"),
    )


def save_cell(model: CellModel, path: str | Path) -> None:
    """Write the model as a cell file that `load_cell` reads back equal to 9 digits; OSError if it cannot."""
    Path(path).write_text(format_cell(model), encoding="utf-8")


def format_cell(model: CellModel) -> str:
    """Return the model as TOML text."""
    nominal = (("v_nominal_v", model.v_nominal_v), ("mass_kg", model.mass_kg))
    lines = [
        f"name = {_quote(model.name)}",
        f"source = {_quote(model.source)}",
        f"capacity_ah = {_number(model.capacity_ah)}",
        f"coulombic_efficiency = {_number(model.coulombic_efficiency)}",
        f"v_min_v = {_number(model.v_min_v)}",
        f"v_max_v = {_number(model.v_max_v)}",
        *(f"{name} = {_number(value)}" for name, value in nominal if value is not None),
        "",
        "[ocv]",
        f'method = "{model.ocv.method}"',
        f"soc = {_row(model.ocv.soc)}",
        f"voltage_v = {_row(model.ocv.voltage_v)}",
        "",
        *(_circuit_lines(model) if model.surface is None else _surface_lines(model.surface)),
    ]
    if model.hysteresis_v:
        lines += ["", "[hysteresis]", f"voltage_v = {_number(model.hysteresis_v)}"]
        lines.append(f"rate = {_number(model.hysteresis_rate)}")
    lines += ["", "[fit]", f"voltage_rms_v = {_number(model.fit_voltage_rms_v)}"]
    lines.append(f"current_max_a = {_number(model.fit_current_max_a)}")
    if model.fit_temperature_degc is not None:
        lines.append(f"temperature_degc = {_row(model.fit_temperature_degc)}")
    lines.append(f"activation_sigma_j_mol = {_number(model.activation_sigma_j_mol)}")
    if model.evidence is not None:
        lines += _evidence_lines(model.evidence)
    limits = {name: getattr(model.limits, name) for name in sorted(SECTIONS["limits"])}
    if given := [f"{name} = {_number(value)}" for name, value in limits.items() if value is not None]:
        lines += ["", "[limits]  # of the data sheet", *given]
    return "\n".join(lines) + "\n"


def _circuit_lines(model: CellModel) -> list[str]:
    lines = [
        "[circuit]  # tables: one row for each temperature, one column for each SOC",
        f"soc = {_row(model.soc_grid)}",
        f"temperature_degc = {_row(model.temperature_grid_degc)}",
        f"r0_ohm = {_table(model.r0_ohm)}",
    ]
    if model.ocv_shift_v is not None and model.ocv_shift_v.any():
        lines.append(f"ocv_shift_v = {_table(model.ocv_shift_v)}")
    for r, tau in zip(model.r_ohm, model.tau_s, strict=True):
        lines += ["", "[[circuit.rc]]", f"r_ohm = {_table(r)}", f"tau_s = {_table(tau)}"]
    if model.overpotential_v is not None and model.overpotential_v.any():
        lines += ["", "[asinh]", f"current_a = {_number(model.overpotential_current_a)}"]
        lines.append(f"voltage_v = {_table(model.overpotential_v)}")
    return lines


def _surface_lines(surface: SurfaceModel) -> list[str]:
    lines = ["[surface]  # at 25 degC; what each means: docs/explanation/identification.md"]
    lines += [f"{name} = {_number(getattr(surface, name))}" for name in NUMBERS]
    lines += [f"{name} = {_row(np.array(getattr(surface, name)))}" for name in ROWS]
    for lag in surface.lags:
        lines += ["", "[[surface.lag]]", *(f"{name} = {_number(value)}" for name, value in lag._asdict().items())]
    return lines


def _evidence_lines(evidence: Evidence) -> list[str]:
    lines = [f"has_ocv = {int(evidence.has_ocv)}  # 0: nothing measured it"]
    if evidence.soc:
        lines.append(f"soc = {_row(np.array(evidence.soc))}")
    if evidence.lowest:
        degc, soc = np.array(evidence.lowest).T
        lines += [f"lowest_degc = {_row(degc)}", f"lowest_soc = {_row(soc)}  # seen under load there or colder"]
    if evidence.held:
        seconds, amps = np.array(evidence.held).T
        lines.append(f"held_s = {_row(seconds)}  # for so long ...")
        lines.append(f"held_a = {_row(amps)}  # ... the largest current that was measured")
    if evidence.sigma:
        lines += ["", "[sigma]  # of the numbers above: shares, energies in J/mol"]
        lines += [f"{name} = {_number(value)}" for name, value in evidence.sigma]
    errors = {"degc": evidence.by_degc, "soc": evidence.by_soc, "current_c": evidence.by_c}
    if any(errors.values()):
        lines += ["", "[errors]  # RMS of the voltage that was fitted, by temperature, SOC and current"]
    for name, pairs in errors.items():
        if pairs:
            at, volts = np.array(pairs).T
            lines += [f"{name} = {_row(at)}", f"{name.removesuffix('_c')}_v = {_row(volts)}"]
    return lines


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
