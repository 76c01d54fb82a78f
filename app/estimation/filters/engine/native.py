"""The C engine: one filter over all cells, in memory of numpy's."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from dataclasses import astuple
from typing import Any, Final

import numpy as np
from numpy.typing import DTypeLike, NDArray

from app.estimation.arrays import FloatArray
from app.estimation.cell_model.circuit import MAX_RC_PAIRS
from app.estimation.filters.engine.library import (
    CELLS,
    LANES,
    RC_MAX,
    CallStruct,
    CellModelStruct,
    FilterStruct,
    SampleStruct,
    SigmaRuleStruct,
    TuningStruct,
    load,
)
from app.estimation.filters.estimates import N_OUT
from app.estimation.filters.setup import FilterSetup
from app.estimation.filters.tables import UNCERTAINTY_DEGC, CellTables

VECTOR_BYTES: Final = 64  # widest vector that a processor has
ANSWERS: Final = 32  # steps whose answers share one allocation: an array of its own for each takes longer
WIDTHS: Final = (4, 8)  # columns of the packed table that the engine is quick with

assert MAX_RC_PAIRS + 1 == RC_MAX


class NativeEngine:
    """One filter over n_cells cells, computed by the shared library, and its state.

    The state's quantities have the names of `vw_cells` in `vw_filter.h`: `branch_a` is (n_rc, n_cells), `cov`
    (1 + n_rc, 1 + n_rc, n_cells), the starts' (4, n_cells), all others (n_cells,).
    """

    def __init__(self, setup: FilterSetup, n_cells: int) -> None:
        """Begin.

        Raises:
            EstimatorError: the library is missing, or does not fit this machine or these sources.
        """
        self.n_cells = n_cells
        self._setup = setup
        self._library = load()
        self._step = self._library.vw_library_step
        self._table = _packed(setup.cell)
        self._blocks = _zeros(-(-n_cells // LANES), CELLS)
        self._voltage_v, self._temperature_degc = _zeros((2, n_cells))
        self._answers: Iterator[FloatArray] = iter(())
        rule = (setup.rule.spread, setup.rule.weight, setup.rule.curvature) if setup.rule else (0.0, 0.0, 0.0)
        self._filter = FilterStruct(
            n_cells,
            setup.kind,
            0.0,
            0.0,
            0.0,
            0.0,
            0.0,
            SigmaRuleStruct(*rule),
            TuningStruct(*astuple(setup.tuning)),
            _model(setup.cell, self._table),
        )
        #: what every function of the library begins with: filter and cells
        self.at = ctypes.byref(self._filter), ctypes.c_void_p(self._blocks.ctypes.data)
        self._library.vw_filter_init(*self.at)
        self._call = CallStruct(
            ctypes.addressof(self._filter),
            self._blocks.ctypes.data,
            SampleStruct(0.0, 0.0, self._voltage_v.ctypes.data, self._temperature_degc.ctypes.data),
            None,
        )
        self._sample = self._call.sample
        self._call_at = ctypes.byref(self._call)
        # both fields of the sample as one view: half the time of setting each
        scalars = slice(CallStruct.sample.offset, CallStruct.sample.offset + 2 * ctypes.sizeof(ctypes.c_double))
        self._dt_and_current = memoryview(self._call).cast("B")[scalars].cast("d")

    def start(
        self,
        current_a: float,
        voltage_v: FloatArray,
        temperature_degc: FloatArray,
        soc: FloatArray,
        soc_sigma: FloatArray,
    ) -> None:
        """Set the state from one sample and an initial SOC (n_cells,), each NaN where it is not known."""
        self._take(0.0, current_a, voltage_v, temperature_degc)
        given = [np.ascontiguousarray(values, dtype=np.float64) for values in (soc, soc_sigma)]
        pointers = [ctypes.c_void_p(values.ctypes.data) for values in given]
        self._library.vw_filter_start(*self.at, ctypes.byref(self._sample), *pointers)

    def step(self, dt_s: float, current_a: float, voltage_v: FloatArray, temperature_degc: FloatArray) -> FloatArray:
        """Return (8, n_cells) estimates after one sample, a new array; rows as in `Estimates`.

        Args:
            dt_s: since the sample before, finite and >= 0 [s].
            current_a: held over that time [A]; NaN or impossible: the last one counts.
            voltage_v: (n_cells,) [V]; NaN or impossible: not measured.
            temperature_degc: (n_cells,) [degC]; NaN or impossible: the last one counts.
        """
        numbers = self._dt_and_current
        numbers[0] = dt_s
        numbers[1] = current_a
        self._voltage_v[...] = voltage_v
        self._temperature_degc[...] = temperature_degc
        for answer in self._answers:
            self._step(self._call_at)
            return answer
        self._make_room()
        return self.step(dt_s, current_a, voltage_v, temperature_degc)

    def record(
        self,
        dt_s: FloatArray,
        current_a: FloatArray,
        voltage_v: FloatArray,
        temperature_degc: FloatArray,
        n_rows: int = N_OUT,
    ) -> FloatArray:
        """Return (n_rows, n_steps, n_cells) estimates of samples in a row: (n_steps,) and (n_steps, n_cells) each."""
        n_steps = dt_s.size
        numbers = np.empty((n_steps, n_rows, self.n_cells))
        samples = [np.ascontiguousarray(a, dtype=np.float64) for a in (dt_s, current_a, voltage_v, temperature_degc)]
        *inputs, output = [ctypes.c_void_p(values.ctypes.data) for values in (*samples, numbers)]
        self._library.vw_filter_record(*self.at, ctypes.c_int64(n_steps), *inputs, ctypes.c_int32(n_rows), output)
        return numbers.swapaxes(0, 1)

    def get(self, name: str) -> FloatArray:
        """Return a copy of one quantity of the state."""
        rows = np.moveaxis(self._blocks[name], 0, 1)  # (rows, blocks, lanes)
        values = rows.reshape(rows.shape[0], -1)[:, : self.n_cells]
        n_rc = self._setup.cell.n_rc
        if name == "branch_a":
            return np.array(values[:n_rc])
        if name == "cov":
            cov = np.empty((1 + n_rc, 1 + n_rc, self.n_cells))
            for row, (u, w) in enumerate(zip(*np.tril_indices(1 + n_rc), strict=True)):
                cov[u, w] = cov[w, u] = values[row]
            return cov
        if name == "gain_slope":
            return np.array(values[: 1 + n_rc])
        return np.array(values if name.startswith("start_") else values[0])

    def set(self, name: str, values: FloatArray) -> None:
        """Replace one quantity of the state."""
        if name == "cov":
            values = values[np.tril_indices(values.shape[0])]
        values = np.atleast_2d(values)
        field = self._blocks[name]  # (blocks, rows, lanes)
        for block, first in enumerate(range(0, self.n_cells, LANES)):
            of_block = values[:, first : first + LANES]
            field[block, : of_block.shape[0], : of_block.shape[1]] = of_block

    def _make_room(self) -> None:
        """Make arrays for the next answers, which the library fills one after the other."""
        size = ANSWERS * N_OUT * self.n_cells
        memory = np.empty(size + VECTOR_BYTES // 8)
        address = memory.ctypes.data
        skipped = -address % VECTOR_BYTES // 8
        self._call.estimates = address + 8 * skipped
        self._answers = iter(memory[skipped : skipped + size].reshape(ANSWERS, N_OUT, self.n_cells))

    def _take(self, dt_s: float, current_a: float, voltage_v: FloatArray, temperature_degc: FloatArray) -> None:
        self._sample.dt_s, self._sample.current_a = dt_s, current_a
        self._voltage_v[...] = voltage_v
        self._temperature_degc[...] = temperature_degc


def _zeros(shape: int | tuple[int, ...], dtype: DTypeLike = np.float64) -> NDArray[Any]:
    """Return a new array that begins where a vector of the processor does."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    memory = np.zeros(size + VECTOR_BYTES, np.uint8)
    start = -memory.ctypes.data % VECTOR_BYTES
    return memory[start : start + size].view(dtype).reshape(shape)


def _packed(cell: CellTables) -> FloatArray:
    """Return the cell's table with the numbers of a point as one vector."""
    narrow, wide = WIDTHS
    table = cell.packed(narrow if cell.packed().shape[-1] <= narrow else wide)
    aligned = _zeros(table.shape)
    aligned[...] = table
    return aligned


def _model(cell: CellTables, table: FloatArray) -> CellModelStruct:
    """Return the struct of a cell's tables, which have to outlive it; `table` is the packed one."""
    model = cell.model
    return CellModelStruct(
        cell.n_rc,
        cell.soc.size,
        cell.temperature_degc.size,
        cell.has_overpotential,
        cell.has_tau_table,
        cell.has_surface,
        cell.slow_pair,
        cell.uncertainty.shape[0],
        table.shape[-1],
        cell.soc_low,
        cell.soc_step,
        model.capacity_ah,
        model.coulombic_efficiency,
        model.overpotential_current_a,
        model.hysteresis_v,
        model.hysteresis_rate,
        model.drop_per_c_v / model.c_rate_a,
        cell.seen_a,
        UNCERTAINTY_DEGC[0],
        UNCERTAINTY_DEGC[2],
        *(
            array.ctypes.data
            for array in (
                cell.temperature_degc,
                table,
                cell.ocv_slope_v,
                cell.reading_slope_v,
                cell.tau_s,
                cell.uncertainty,
                cell.surface,
            )
        ),
    )
