"""The compiled engine of the filters: one call of a numba kernel for a step, one for a whole record.

Importing this module without numba raises ImportError; `engine_of` in `filters` chooses.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from app.estimation.circuit import SECONDS_PER_HOUR
from app.estimation.estimates import Estimates
from app.estimation.fusion import unknown_odds
from app.estimation.kernel_filters import advance_any, advance_pair
from app.estimation.kernel_parts import N_FLAGS, N_OUT, Numbers
from app.estimation.kernels import record_any, record_pair
from app.estimation.record import Record
from app.estimation.sigma_points import SigmaRule
from app.estimation.states import CellStates
from app.estimation.tables import PackedCell
from app.estimation.tuning import Tuning

FloatArray = NDArray[np.float64]

PAIR: Final = 2  # RC pairs of the kernel that is written out


class FastStep:
    """One compiled step over all cells of a state, for one cell model, rule and tuning; compiled when built."""

    def __init__(
        self, cell: PackedCell, states: CellStates, rule: SigmaRule | None, tuning: Tuning, fused: bool
    ) -> None:
        ocv = np.ascontiguousarray(np.concatenate((cell.ocv, cell.ocv_slope)).T)
        circuit = np.ascontiguousarray(cell.circuit.transpose(2, 0, 1))
        tau = cell.tau_s if cell.tau_fixed_s is None else cell.tau_fixed_s.reshape(-1, 1, 1).copy()
        grid = np.ascontiguousarray(cell.temperature_grid_degc)
        numbers = _numbers(cell, rule, tuning, fused)
        self._states = states
        self._tables = (ocv, circuit, tau, grid, numbers)
        is_pair = rule is not None and cell.model.n_rc == PAIR and cell.tau_fixed_s is not None
        self._advance: Any = advance_pair if is_pair else advance_any
        self._record: Any = record_pair if is_pair else record_any
        self._warm_up()

    def step(self, dt_s: float, current_a: float, voltage_v: FloatArray, temperature_degc: FloatArray) -> Estimates:
        """Return the estimates after one sample that `InputGuard` has checked for shape, step and current."""
        n = voltage_v.size
        out, flags = np.empty((N_OUT, n)), np.empty((N_FLAGS, n), dtype=np.bool_)
        self._advance(self._states.block, *self._tables, dt_s, current_a, voltage_v, temperature_degc, out, flags)
        return Estimates(*out, *flags)

    def record(
        self, dt_s: FloatArray, current_a: FloatArray, voltage_v: FloatArray, temperature_degc: FloatArray
    ) -> Record:
        """Return the estimates of a whole record.

        Args:
            dt_s: (n_steps,) [s].
            current_a: (n_steps,) finite [A].
            voltage_v: (n_steps, n_cells) [V].
            temperature_degc: (n_steps, n_cells) [degC].
        """
        steps, n = voltage_v.shape
        out = np.empty((steps, N_OUT, n))
        flags = np.empty((steps, N_FLAGS, n), dtype=np.bool_)
        self._record(self._states.block, *self._tables, dt_s, current_a, voltage_v, temperature_degc, out, flags)
        return Record(*np.moveaxis(out, 1, 0), *np.moveaxis(flags, 1, 0))

    def _warm_up(self) -> None:
        """Compile, or load from the cache, with a state of no cells."""
        block = np.zeros((self._states.block.shape[0], 0))
        none, no_steps = np.zeros(0), np.zeros((0, 0))
        out, flags = np.zeros((N_OUT, 0)), np.zeros((N_FLAGS, 0), dtype=np.bool_)
        self._advance(block, *self._tables, 0.1, 0.0, none, none, out, flags)
        self._record(block, *self._tables, none, none, no_steps, no_steps, out[None], flags[None])


def _numbers(cell: PackedCell, rule: SigmaRule | None, tuning: Tuning, fused: bool) -> FloatArray:
    """Return everything scalar that the kernels read, in the order of `Numbers`."""
    model = cell.model
    values: dict[str, float] = {
        "is_sigma": 0.0 if rule is None else 1.0,
        "is_fused": 1.0 if fused else 0.0,
        "spread": rule.spread if rule else 0.0,
        "weight": rule.weight if rule else 0.0,
        "curvature": rule.curvature if rule else 0.0,
        "unknown_odds": unknown_odds(tuning),
        "capacity_coulomb": SECONDS_PER_HOUR * model.capacity_ah,
        "capacity_ah": model.capacity_ah,
        "efficiency": model.coulombic_efficiency,
        "i_ref": model.overpotential_current_a,
        "hysteresis_v": model.hysteresis_v,
        "hysteresis_rate": model.hysteresis_rate,
        "model_error_per_a_v": tuning.model_error_rel * model.drop_per_c_v / model.c_rate_a,
        "empty_slope": (tuning.empty_factor - 1.0) / tuning.empty_soc,
    }
    values |= asdict(tuning)
    return np.array([values[name] for name in Numbers._fields])
