"""Compiled: whole records through the step of a filter; needs the extra `voltwall[fast]`."""

from __future__ import annotations

from app.estimation.kernel_filters import advance_any, advance_pair
from app.estimation.kernel_parts import jit

# mypy: disable-error-code="no-untyped-def,no-untyped-call,call-arg"
# ruff: noqa: ANN001, ANN201


@jit
def record_pair(block, ocv, circuit, tau, grid, numbers, dt_s, current_a, voltage_v, temperature_degc, out, flags):
    """Run `advance_pair` over (n_steps,) samples; `out` is (n_steps, 6, n_cells), `flags` (n_steps, 2, n_cells)."""
    for k in range(dt_s.size):
        advance_pair(block, ocv, circuit, tau, grid, numbers, dt_s[k], current_a[k], voltage_v[k],
                     temperature_degc[k], out[k], flags[k])  # fmt: skip


@jit
def record_any(block, ocv, circuit, tau, grid, numbers, dt_s, current_a, voltage_v, temperature_degc, out, flags):
    """Run `advance_any` over (n_steps,) samples; `out` is (n_steps, 6, n_cells), `flags` (n_steps, 2, n_cells)."""
    for k in range(dt_s.size):
        advance_any(block, ocv, circuit, tau, grid, numbers, dt_s[k], current_a[k], voltage_v[k],
                    temperature_degc[k], out[k], flags[k])  # fmt: skip
