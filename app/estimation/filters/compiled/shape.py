"""What a kernel is compiled for and how the arrays it works on are laid out; known with or without numba.

Every array is flat; row r of n cells begins at r n. The arena holds, one after the other, what stays the same
(NUMBERS, temperatures, time constants, table), then places, work, the sample (step, current, voltages, temperatures)
and the answer.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from app.estimation.filters.estimates import N_OUT
from app.estimation.filters.tables import N_SOC

PLACED, PLACE_OFFSET, PLACE_WEIGHT, PLACE_NOISE = range(4)  # rows: temperatures, and what follows from them
N_PLACE: Final = 4


class Shape(NamedTuple):
    """What a kernel is compiled for.

    Attributes:
        n: number of cells.
        m: RC pairs.
        n_t: temperatures of the tables.
        has_over: whether there is an asinh overpotential.
        is_fixed: whether the time constants are the same at any SOC and temperature.
        is_sigma: sigma points, or else the tangent.
        is_fused: whether a charge count is fused.
    """

    n: int
    m: int
    n_t: int
    has_over: bool
    is_fixed: bool
    is_sigma: bool
    is_fused: bool


NUMBERS: Final = (
    "spread",
    "weight",
    "curvature",
    "unknown_odds",
    "capacity_coulomb",
    "capacity_ah",
    "efficiency",
    "i_ref",
    "hysteresis_v",
    "hysteresis_rate",
    "empty_slope",
    "empty_soc",
    "model_error_v",
    "model_error_rel",
    "drop_per_a_v",
    "correlation_s",
    "bias_v",
    "bias_s",
    "cold_factor",
    "soc_walk",
    "branch_rel",
    "branch_c",
    "gate",
    "gate_hold_s",
    "gate_recovery",
    "counter_gain",
    "counter_offset_c",
    "wander_s",
    "wander_factor",
    "anchor_s",
    "anchor_factor",
    "doubt_soc",
    "check_s",
    "check_rms_v",
    "check_bias_v",
)  # every scalar the kernels read: rule, cell and tuning, with the names and units they have there
(
    SPREAD,
    WEIGHT,
    CURVATURE,
    UNKNOWN_ODDS,
    CAPACITY_COULOMB,
    CAPACITY_AH,
    EFFICIENCY,
    I_REF,
    HYSTERESIS_V,
    HYSTERESIS_RATE,
    EMPTY_SLOPE,
    EMPTY_SOC,
    MODEL_ERROR_V,
    MODEL_ERROR_REL,
    DROP_PER_A_V,
    CORRELATION_S,
    BIAS_V,
    BIAS_S,
    COLD_FACTOR,
    SOC_WALK,
    BRANCH_REL,
    BRANCH_C,
    GATE,
    GATE_HOLD_S,
    GATE_RECOVERY,
    COUNTER_GAIN,
    COUNTER_OFFSET_C,
    WANDER_S,
    WANDER_FACTOR,
    ANCHOR_S,
    ANCHOR_FACTOR,
    DOUBT_SOC,
    CHECK_S,
    CHECK_RMS_V,
    CHECK_BIAS_V,
) = range(len(NUMBERS))


N_WORK: Final = 6  # rows of work that every model has
HERE, RIGHT, LEFT, REACH, STEEP, OCV_SLOPE = range(N_WORK)


def work_rows(shape: Shape) -> int:
    """Return how many rows of work a kernel needs: those, 3 for each RC pair and 1, and the terms of 3 points."""
    return N_WORK + 3 * shape.m + 1 + 3 * columns(shape)


def table_width(shape: Shape) -> int:
    """Return how many numbers the table has for a SOC and a temperature.

    Columns (OCV, -R0, -e, -R_k): values, differences to the next SOC, to the next temperature, and both; then for
    the tangent the slope of the OCV and its difference to the next SOC.
    """
    return 4 * columns(shape) + (0 if shape.is_sigma else 2)


def columns(shape: Shape) -> int:
    """Return how many terms the output has, rounded up to fours: so many are looked up at once."""
    return 4 * ((5 + shape.has_over + shape.m) // 4)


class Layout(NamedTuple):
    """Where the parts of the arena begin; NUMBERS begin at 0."""

    temperatures: int
    time_constants: int
    table: int
    places: int
    work: int
    step: int
    voltages: int
    temperatures_now: int
    answer: int
    end: int


def layout(shape: Shape) -> Layout:
    """Return where the parts of the arena begin."""
    lengths = (
        len(NUMBERS),
        shape.n_t,
        shape.m * (1 if shape.is_fixed else shape.n_t * N_SOC),
        table_width(shape) * shape.n_t * N_SOC,
        N_PLACE * shape.n,
        work_rows(shape) * shape.n,
        2,
        shape.n,
        shape.n,
        N_OUT * shape.n,
    )
    return Layout(*(sum(lengths[: k + 1]) for k in range(len(lengths))))
