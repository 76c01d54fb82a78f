"""State of power along a recording: columns for the table, a summary as JSON and as text."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from app.commands.cell_commands.filter_run import DEFAULT_TEMPERATURE_DEGC, Run
from app.estimation.arrays import FloatArray
from app.estimation.cell_model.circuit import CellModel
from app.estimation.prediction.constant_current import OperatingPoint
from app.estimation.prediction.power import COVERAGE
from app.estimation.prediction.power_along import PowerAlong, branch_currents, limits_of, power_along, voltage_ahead
from app.estimation.recording.cell_recording import Recording


def power_of(recording: Recording, result: Run, cell: CellModel) -> Iterator[PowerAlong]:
    """Return the state of power at every row of a recording that was estimated."""
    degc = np.where(np.isnan(recording.temperature_degc), DEFAULT_TEMPERATURE_DEGC, recording.temperature_degc)
    branches = branch_currents(cell, recording.step_s, recording.current_a, result.soc, degc)
    states = OperatingPoint(result.soc, branches, degc)
    current_a, voltage_v = recording.current_a, recording.voltage_v
    foretold = voltage_ahead(cell, recording.time_s, current_a, voltage_v, states, result.soc_sigma)
    return power_along(cell, states, result.soc_sigma, foretold.scale)


def power_columns(held: Sequence[PowerAlong]) -> dict[str, FloatArray]:
    """Return the columns of the table: power and its band [W], and 1 where the current was never measured."""
    columns = {}
    for power in held:
        name = f"power_{power.direction}_{power.horizon_s:g}s"
        columns[f"{name}_w"] = power.power_w
        columns[f"{name}_low_w"] = power.low_w
        columns[f"{name}_high_w"] = power.high_w
        columns[f"{name}_beyond_measured"] = power.beyond_measured.astype(np.float64)
    return columns


def power_summary(held: Sequence[PowerAlong], cell: CellModel) -> dict[str, Any]:
    """Return the state of power at the last row and its extremes, and under which condition it holds."""
    limits = limits_of(cell)
    return {
        "power_coverage": COVERAGE,
        "power_measured_current_max_a": cell.fit_current_max_a or None,
        "power_limits": {
            "v_min_v": limits.v_min_v,
            "v_max_v": limits.v_max_v,
            "discharge_max_a": cell.limits.discharge_max_a,
            "charge_max_a": cell.limits.charge_max_a,
            "temperature_max_degc": limits.temperature_max_degc,
        },
        "power": [
            {
                "direction": power.direction,
                "horizon_s": power.horizon_s,
                "last_w": float(power.power_w[-1]),
                "last_low_w": float(power.low_w[-1]),
                "last_high_w": float(power.high_w[-1]),
                "least_w": float(power.power_w.min()),
                "largest_w": float(power.power_w.max()),
                "beyond_measured_frac": float(power.beyond_measured.mean()) if cell.fit_current_max_a else None,
            }
            for power in held
        ],
    }


def print_power(report: dict[str, Any]) -> None:
    """Print the summary."""
    print(f"  state of power at the last row, bands hold the truth in {100 * report['power_coverage']:.0f} % of cases:")
    for each in report["power"]:
        print(
            f"    {each['direction']:9} {each['horizon_s']:2g} s {each['last_w']:8.1f} W "
            f"({each['last_low_w']:.1f} to {each['last_high_w']:.1f}), along the recording {each['least_w']:.1f} to "
            f"{each['largest_w']:.1f} W{_beyond(each['beyond_measured_frac'])}"
        )
    limits, measured_a = report["power_limits"], report["power_measured_current_max_a"]
    if limits["discharge_max_a"] is None or limits["charge_max_a"] is None:
        print("    the cell file names no largest current: only voltage, charge and temperature limit")
    if measured_a is None:
        print("    the cell file does not say up to which current it was measured")
    elif any(each["beyond_measured_frac"] for each in report["power"]):
        print(f"    extrapolated where marked: no current above {measured_a:.3g} A was measured for the cell file")


def _beyond(share: float | None) -> str:
    return f", extrapolated {100 * share:.0f} % of the time" if share else ""
