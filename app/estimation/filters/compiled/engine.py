"""The compiled engine of the filters: one call of a kernel for a step, one for a whole record."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
from numpy.typing import ArrayLike

from app.estimation.arrays import FloatArray
from app.estimation.cell_model.circuit import SECONDS_PER_HOUR
from app.estimation.filters.compiled.native import load
from app.estimation.filters.compiled.shape import NUMBERS, Shape, columns, layout, table_width
from app.estimation.filters.estimates import N_OUT, Estimates
from app.estimation.filters.fusion import unknown_odds
from app.estimation.filters.inputs import cell_array
from app.estimation.filters.record import Record
from app.estimation.filters.sigma_points import SigmaRule
from app.estimation.filters.states import CellStates
from app.estimation.filters.tables import BRANCH, R0, PackedCell
from app.estimation.filters.tuning import Tuning


class FastStep:
    """One compiled step over all cells of a state, for one cell model, rule and tuning; compiled when built."""

    def __init__(
        self,
        cell: PackedCell,
        states: CellStates,
        rule: SigmaRule | None,
        tuning: Tuning,
        fused: bool,
    ) -> None:
        n, is_fixed = states.n_cells, cell.tau_fixed_s is not None
        self._shape = Shape(n, states.n_rc, cell.n_t, cell.has_overpotential, is_fixed, rule is not None, fused)
        at = layout(self._shape)
        arena = np.zeros(at.end)
        arena[: at.temperatures] = _numbers(cell, rule, tuning)
        arena[at.temperatures : at.time_constants] = cell.temperature_grid_degc
        arena[at.time_constants : at.table] = (cell.tau_s if cell.tau_fixed_s is None else cell.tau_fixed_s).ravel()
        arena[at.table : at.places] = _table(cell, self._shape)
        arena[at.places : at.work] = np.nan
        self._cells = (n,)
        self._now = arena[at.step : at.voltages]
        self._voltages_v = arena[at.voltages : at.temperatures_now]
        self._temperatures_degc = arena[at.temperatures_now : at.answer]
        self._numbers = arena[at.answer :].reshape(N_OUT, n)
        self._held = states.block, arena
        self._pointers = states.block.ctypes.data, arena.ctypes.data
        self._step = load("step", self._shape)

    def step(self, dt_s: float, current_a: float, voltages_v: ArrayLike, temperatures_degc: ArrayLike) -> Estimates:
        """Return the estimates after one sample.

        Args:
            dt_s: step, >= 0 [s].
            current_a: held current, finite [A].
            voltages_v: (n,) [V].
            temperatures_degc: (n,) [degC].

        Raises:
            ShapeError: an array is not (n,).
        """
        shape = self._cells
        try:
            fits = voltages_v.shape == shape and temperatures_degc.shape == shape  # type: ignore[union-attr]
        except AttributeError:
            fits = False
        if not fits:
            voltages_v = cell_array("voltages_v", voltages_v, shape)
            temperatures_degc = cell_array("temperatures_degc", temperatures_degc, shape)
        self._voltages_v[...] = voltages_v
        self._temperatures_degc[...] = temperatures_degc
        now = self._now
        now[0] = dt_s
        now[1] = current_a
        block_at, arena_at = self._pointers
        self._step(block_at, arena_at)
        return Estimates(self._numbers.copy())

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
        numbers = np.empty((steps, N_OUT, n))
        samples = [np.ascontiguousarray(a, dtype=np.float64) for a in (dt_s, current_a, voltage_v, temperature_degc)]
        record = load("record", self._shape)
        record(*self._pointers, steps, *(a.ctypes.data for a in samples), numbers.ctypes.data)
        return Record(np.moveaxis(numbers, 1, 0))


def _table(cell: PackedCell, shape: Shape) -> FloatArray:
    """Return the flat table of `table_width` numbers for each SOC of each temperature."""
    m = cell.model.n_rc
    order = [R0, *([BRANCH + m] if shape.has_over else []), *range(BRANCH, BRANCH + m)]
    value, by_soc, by_temperature, by_both = -cell.circuit[:, order]
    ocv = np.tile(np.concatenate((cell.ocv, cell.ocv_slope)), (1, cell.n_t))
    width = columns(shape)
    table = np.zeros((value.shape[1], table_width(shape)))
    for k, (first, rest) in enumerate(((ocv[0], value), (ocv[1], by_soc), (0.0, by_temperature), (0.0, by_both))):
        table[:, k * width] = first
        table[:, k * width + 1 : k * width + 1 + len(order)] = rest.T
    if not shape.is_sigma:
        table[:, 4 * width :] = ocv[2:].T
    return table.reshape(-1)


def _numbers(cell: PackedCell, rule: SigmaRule | None, tuning: Tuning) -> FloatArray:
    """Return everything scalar that the kernels read, in the order of NUMBERS."""
    model = cell.model
    values: dict[str, float] = {
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
        "drop_per_a_v": model.drop_per_c_v / model.c_rate_a,
        "empty_slope": (tuning.empty_factor - 1.0) / tuning.empty_soc,
    }
    values |= asdict(tuning)
    return np.array([values[name] for name in NUMBERS])
