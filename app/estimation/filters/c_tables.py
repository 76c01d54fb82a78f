"""A cell model, the tuning and the fused filter as a C header: what the engine needs on a microcontroller."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.cell_model.circuit import CellModel
from app.estimation.filters.sigma_points import central_difference
from app.estimation.filters.tables import UNCERTAINTY_DEGC, CellTables
from app.estimation.filters.tuning import Tuning

SOC_STEP = 0.005  # step of the tables: coarser than on a PC, for the flash
LINE = 110


def c_tables(model: CellModel, soc_step: float = SOC_STEP, tuning: Tuning | None = None) -> str:
    """Return the text of a header that defines `vw_cell_model_of_team`, `vw_tuning_of_team` and `vw_rule_of_team`.

    Args:
        model: the cell model.
        soc_step: distance of the tables' points; a step half as wide takes twice the flash.
        tuning: assumptions of the filter; None = the one tuning for all cells.
    """
    cell = CellTables(model, soc_step)
    rule = central_difference(1 + cell.n_rc)
    table = cell.packed()
    fields = {
        "n_rc": cell.n_rc,
        "n_soc": cell.soc.size,
        "n_temperatures": cell.temperature_degc.size,
        "has_overpotential": int(cell.has_overpotential),
        "has_tau_table": int(cell.has_tau_table),
        "has_surface": int(cell.has_surface),
        "slow_pair": cell.slow_pair,
        "n_uncertainty": cell.uncertainty.shape[0],
        "width": table.shape[-1],
        "soc_low": _number(cell.soc_low),
        "soc_step": _number(cell.soc_step),
        "capacity_ah": _number(model.capacity_ah),
        "efficiency": _number(model.coulombic_efficiency),
        "overpotential_a": _number(model.overpotential_current_a),
        "hysteresis_v": _number(model.hysteresis_v),
        "hysteresis_rate": _number(model.hysteresis_rate),
        "drop_per_a_v": _number(model.drop_per_c_v / model.c_rate_a),
        "seen_a": _number(cell.seen_a),
        "uncertainty_low_degc": _number(UNCERTAINTY_DEGC[0]),
        "uncertainty_step_k": _number(UNCERTAINTY_DEGC[2]),
        "temperature_degc": "vw_cell_temperature_degc",
        "table": "vw_cell_table",
        "ocv_slope_v": "vw_cell_ocv_slope_v",
        "reading_slope_v": "vw_cell_reading_slope_v",
        "tau_s": "vw_cell_tau_s",
        "uncertainty": "vw_cell_uncertainty",
        "surface": "vw_cell_surface" if cell.has_surface else "0",
    }
    rule_fields = {name: _number(getattr(rule, name)) for name in ("spread", "weight", "curvature")}
    tuning_fields = {name: _number(value) for name, value in asdict(tuning or Tuning()).items()}
    parts = [
        f"/* {_comment(model.name)}, {model.capacity_ah:g} Ah: written by `voltwall firmware` from its cell file.",
        " * Columns of the table: OCV [V], R0 [ohm], R_k [ohm], overpotential [V], one over its current [1/A]. */",
        "#ifndef VW_CELL_OF_TEAM_H",
        "#define VW_CELL_OF_TEAM_H",
        "",
        '#include "vw_filter.h"',
        "",
        f"#if VW_RC_MAX < {cell.n_rc}",
        f'#error "this cell has {model.n_rc} RC pairs and a lasting error: compile with -DVW_RC_MAX={cell.n_rc}"',
        "#endif",
        "",
        _array("vw_cell_temperature_degc", cell.temperature_degc),
        _array("vw_cell_table", table),
        _array("vw_cell_ocv_slope_v", cell.ocv_slope_v),
        _array("vw_cell_reading_slope_v", cell.reading_slope_v),
        _array("vw_cell_tau_s", cell.tau_s),
        _array("vw_cell_uncertainty", cell.uncertainty),
        *([_array("vw_cell_surface", cell.surface)] if cell.has_surface else []),
        _struct("vw_cell_model", "vw_cell_model_of_team", fields),
        _struct("vw_sigma_rule", "vw_rule_of_team", rule_fields),
        _struct("vw_tuning", "vw_tuning_of_team", tuning_fields),
        "#endif",
        "",
    ]
    return "\n".join(parts)


def _number(value: float) -> str:
    """Return a number as the nearest C literal of single precision."""
    text = f"{value:.8g}"
    return f"{text}f" if any(mark in text for mark in ".e") else f"{text}.0f"


def _comment(text: str) -> str:
    return text.replace("*/", "* /").replace("\n", " ")


def _array(name: str, values: FloatArray) -> str:
    lines, line = [], "   "
    for number in map(_number, np.ravel(values).tolist()):
        if len(line) + len(number) > LINE:
            lines.append(line)
            line = "   "
        line += f" {number},"
    return "\n".join([f"static const vw_real {name}[{values.size}] = {{", *lines, line, "};", ""])


def _struct(kind: str, name: str, fields: Mapping[str, object]) -> str:
    return "\n".join(
        [f"static const {kind} {name} = {{", *(f"    .{key} = {value}," for key, value in fields.items()), "};", ""]
    )
