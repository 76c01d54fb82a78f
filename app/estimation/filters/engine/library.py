"""Finds and loads the shared library; says in which memory layout it computes.

The layouts repeat those of `vw_filter.h` and `vw_cell_model.h`; a test compares the names.
"""

from __future__ import annotations

import ctypes
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np

from app.estimation.errors import EstimatorError
from app.estimation.filters.tuning import Tuning
from firmware_protocol.c_library import SUFFIX, open_library
from firmware_protocol.errors import LibraryError

FOLDER: Final = Path(__file__).resolve().parent
LANES: Final = 32
RC_MAX: Final = 5  # branches: RC pairs and the lasting error
STATES_MAX: Final = 1 + RC_MAX
STARTS: Final = 4

LIBRARY: Final = FOLDER / f"vw_filter{SUFFIX}"  # for every processor of its kind
FASTER: Final = ("avx512", "avx2")  # variants that newer ones run, with the same results; last what most have

CELL_ROWS: Final = {
    "soc": 1,
    "branch_a": RC_MAX,
    "cov": STATES_MAX * (STATES_MAX + 1) // 2,
    "gain": 1,
    "gain_v2": 1,
    "gain_step": 1,
    "gain_slope": STATES_MAX,
    "hysteresis": 1,
    "temperature_degc": 1,
    "capacity_ah": 1,
    "resistance": 1,
    "refused_s": 1,
    "count_soc": 1,
    "count_gain": 1,
    "count_offset": 1,
    "anchor_v2": 1,
    "rest_mean_v": 1,
    "rest_moment": 1,
    "unsettled_v2": 1,
    "drawn": 1,
    "start_soc": STARTS,
    "start_v2": STARTS,
    "start_weight": STARTS,
    "best_soc": 1,
    "best_v2": 1,
    "best_drawn": 1,
    "best_offset": 1,
    "fused_soc": 1,
    "fused_v2": 1,
    "fused_gain": 1,
    "conflict": 1,
    "apart": 1,
    "apart_v2": 1,
    "wander_v2": 1,
    "check_mean_v": 1,
    "check_square_v2": 1,
    "slow_mean_v": 1,
    "slow_square_v2": 1,
}  # rows that each array of `vw_cells` has
TERM_ROWS: Final = 12 + RC_MAX - 1  # rows of `vw_temperature_terms`, which the engine keeps for itself
COLUMNS_MAX: Final = 8
SEGMENT: Final = np.dtype(
    [("column", np.int32, LANES), *[(name, np.float64, (COLUMNS_MAX, LANES)) for name in ("low", "rise")]]
)  # `vw_segment`
SEGMENTS: Final = 4
CELLS: Final = np.dtype(
    [
        *[(name, np.float64, (rows, LANES)) for name, rows in (CELL_ROWS | {"terms": TERM_ROWS}).items()],
        ("segments", SEGMENT, SEGMENTS),
    ]
)

_real, _int32, _pointer = ctypes.c_double, ctypes.c_int32, ctypes.c_void_p


class TuningStruct(ctypes.Structure):
    """`vw_tuning`."""

    _fields_ = [(field.name, _real) for field in fields(Tuning)]


class SigmaRuleStruct(ctypes.Structure):
    """`vw_sigma_rule`."""

    _fields_ = [(name, _real) for name in ("spread", "weight", "curvature")]


class CellModelStruct(ctypes.Structure):
    """`vw_cell_model`."""

    _fields_ = [
        *[(name, _int32) for name in ("n_rc", "n_soc", "n_temperatures", "has_overpotential", "has_tau_table")],
        *[(name, _int32) for name in ("has_surface", "slow_pair", "n_uncertainty", "width")],
        *[(name, _real) for name in ("soc_low", "soc_step", "capacity_ah", "efficiency", "overpotential_a")],
        *[
            (name, _real)
            for name in (
                "hysteresis_v",
                "hysteresis_rate",
                "drop_per_a_v",
                "seen_a",
                "uncertainty_low_degc",
                "uncertainty_step_k",
            )
        ],
        *[
            (name, _pointer)
            for name in (
                "temperature_degc",
                "table",
                "ocv_slope_v",
                "reading_slope_v",
                "tau_s",
                "uncertainty",
                "surface",
            )
        ],
    ]


class FilterStruct(ctypes.Structure):
    """`vw_filter`."""

    _fields_ = [
        ("n_cells", _int32),
        ("kind", _int32),
        ("current_a", _real),
        ("since_s", _real),
        *[(name, _real) for name in ("rest_s", "flow_a", "beyond_a")],
        ("rule", SigmaRuleStruct),
        ("tuning", TuningStruct),
        ("model", CellModelStruct),
    ]


class SampleStruct(ctypes.Structure):
    """`vw_sample`."""

    _fields_ = [("dt_s", _real), ("current_a", _real), ("voltage_v", _pointer), ("temperature_degc", _pointer)]


class CallStruct(ctypes.Structure):
    """`vw_library_call`."""

    _fields_ = [("filter", _pointer), ("cells", _pointer), ("sample", SampleStruct), ("estimates", _pointer)]


class LearningStruct(ctypes.Structure):
    """`vw_learning`."""

    _fields_ = [(name, _real) for name in ("every_s", "since_s", "sigma_max", "shape_error", "less_shape_error")]


@cache
def load() -> ctypes.PyDLL:
    """Return the library, in the fastest variant that this processor runs.

    Raises:
        EstimatorError: there is none for this machine, or it was built from other sources than these.
    """
    library = _open(LIBRARY)
    level = library.vw_library_level()
    for variant in FASTER[-level:] if level else ():
        faster = LIBRARY.with_suffix(f".{variant}{LIBRARY.suffix}")
        if faster.is_file():
            return _open(faster)
    return library


def _open(path: Path) -> ctypes.PyDLL:
    try:
        library = open_library(path, sorted(FOLDER.glob("v*.[ch]")))
    except LibraryError as error:
        raise EstimatorError(str(error)) from error
    sizes = library.vw_library_size_of_filter(), library.vw_library_size_of_cells()
    if sizes != (ctypes.sizeof(FilterStruct), CELLS.itemsize):
        raise EstimatorError(f"{path.name} has another memory layout: {sizes}")
    library.vw_library_step.restype = None
    return library
