"""What the compiled kernels share: how they are compiled, and the formulas of scalars.

A kernel is made for a number of cells and a shape of model, which are constants to the compiler: it then knows that
no two rows overlap, unrolls the RC pairs and computes several cells at a time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numba

from app.estimation.filters.compiled.shape import (
    CAPACITY_COULOMB,
    DROP_PER_A_V,
    EFFICIENCY,
    MODEL_ERROR_REL,
    MODEL_ERROR_V,
    SOC_WALK,
)
from app.estimation.filters.process import SOC_VARIANCE_MAX, VARIANCE_STEP

# mypy: disable-error-code="no-untyped-def,no-untyped-call,call-arg"
# ruff: noqa: ANN001, ANN201

numba.config.SLP_VECTORIZE = 1  # type: ignore[attr-defined]  # the look-ups take four columns at once


def jit(function: Callable[..., Any]) -> Any:
    """Compile when first called."""
    options: dict[str, Any] = {"error_model": "numpy", "_nrt": False}  # nothing here is allocated
    return numba.njit(**options)(function)


def inline(function: Callable[..., Any]) -> Any:
    """Compile into the callers, for what takes and gives scalars."""
    return numba.njit(error_model="numpy", inline="always")(function)


@inline
def moved_soc(numbers, dt, i):
    """Return the share of the capacity that a held current takes out."""
    kept = numbers[EFFICIENCY] if i < 0.0 else 1.0
    return kept * i * dt / numbers[CAPACITY_COULOMB]


@inline
def soc_walk(numbers, dt):
    """Return what the SOC's variance grows by, and the factor that keeps it below its maximum."""
    walk = min(numbers[SOC_WALK] * numbers[SOC_WALK] * dt, SOC_VARIANCE_MAX) + VARIANCE_STEP
    return walk, math.sqrt(max(1.0 - walk / SOC_VARIANCE_MAX, 0.0))


@inline
def noise_variance(numbers, i):
    """Return the variance of the voltage's model error [V^2] at a current."""
    with_current = numbers[MODEL_ERROR_REL] * (numbers[DROP_PER_A_V] * i)
    return numbers[MODEL_ERROR_V] * numbers[MODEL_ERROR_V] + with_current * with_current
