"""The accumulator as a whole: from the cells, or from the master's own fields where cells are missing."""

import math
from typing import Any

import numpy as np

from app.live.cells import extreme, mean
from app.sources.master.decode import Decoder
from app.telemetry import Accumulator, Cells, Flags, FloatArray, MasterState
from firmware_protocol.memory_map import N_CELLS, T_MISSING, V_MISSING


def accumulator_of(
    cells: Cells, decoder: Decoder, driver_percent: int | None, energy_out_wh: float, energy_in_wh: float
) -> Accumulator:
    """Voltage, current, power, charge, the extremes with their cell, and the energy that flowed since the start."""
    voltage_v, current_a = decoder.number("v_tot") or None, decoder.number("i_fs")  # 0 V: no cell was measured
    if voltage_v is None and not math.isnan(total := float(cells.voltage_v.sum())):
        voltage_v = total
    low_v, low_cell = extreme(cells.voltage_v, highest=False)
    high_v, high_cell = extreme(cells.voltage_v, highest=True)
    if low_v is None:
        low_v, low_cell = _master_extreme(decoder, "v_min", missing=V_MISSING)
        high_v, high_cell = _master_extreme(decoder, "v_max", missing=V_MISSING)
    cold, cold_cell = extreme(cells.temperature_degc, highest=False)
    hot, hot_cell = extreme(cells.temperature_degc, highest=True)
    if hot is None:
        cold, cold_cell = _master_extreme(decoder, "t_min", missing=T_MISSING)
        hot, hot_cell = _master_extreme(decoder, "t_max", missing=T_MISSING)
    return Accumulator(
        voltage_v=voltage_v,
        current_a=current_a,
        power_w=None if voltage_v is None or current_a is None else voltage_v * current_a,
        voltage_min_v=low_v,
        voltage_min_cell=low_cell,
        voltage_max_v=high_v,
        voltage_max_cell=high_cell,
        voltage_mean_v=mean(cells.voltage_v),
        voltage_delta_v=None if low_v is None or high_v is None else high_v - low_v,
        temperature_min_degc=cold,
        temperature_min_cell=cold_cell,
        temperature_max_degc=hot,
        temperature_max_cell=hot_cell,
        temperature_mean_degc=mean(cells.temperature_degc),
        loaded_cells=int((~np.isnan(cells.voltage_v)).sum()),
        energy_out_wh=energy_out_wh,
        energy_in_wh=energy_in_wh,
        fan_duty=decoder.number("charger.fan_duty"),
        **charge_of(cells.soc, cells.soc_sigma, driver_percent, decoder.number("soc")),
    )


def charge_of(
    soc: FloatArray, sigma: FloatArray, driver_percent: int | None, master_soc: float | None
) -> dict[str, Any]:
    """Fields of Accumulator: the estimated SOC of the cells, else the master's own, and which of the two it is."""
    low, low_cell = extreme(soc, highest=False)
    high, high_cell = extreme(soc, highest=True)
    average, source = mean(soc), "filter"
    if average is None:
        average, source = master_soc, "master"
        # 0.29 is 28.999... hundredths
        driver_percent = None if average is None else math.floor(average * 100 + 1e-9)
    return {
        "soc": average,
        "soc_source": None if average is None else source,
        "soc_sigma": mean(sigma),
        "driver_soc_percent": driver_percent,
        "soc_min": low,
        "soc_min_cell": low_cell,
        "soc_max": high,
        "soc_max_cell": high_cell,
        "soc_spread": None if low is None or high is None else high - low,
    }


def state_of(flags: Flags | None, charger_state: str | None, last_trip: str | None) -> tuple[MasterState, str]:
    """Return what the car does, and why."""
    if flags is None:
        return "unknown", "no status from the master"
    if not flags.fit:
        return "fault", last_trip or "the master holds the shutdown circuit open"
    if flags.charging:
        return "charge", f"charger: {(charger_state or 'state unknown').replace('_', ' ')}"
    if flags.balancing:
        return "balance", "cells are bled to the lowest"
    if flags.load is None:
        return "unknown", "nothing heard of the relays"
    if flags.load:
        return "drive", "relays closed"
    return "idle", "charger connected, not charging" if flags.charger else "relays open"


def _master_extreme(decoder: Decoder, name: str, *, missing: int) -> tuple[float | None, int | None]:
    """The master's own (value, cell); a cell that there is not is none."""
    if decoder.integer(name) == missing:
        return None, None
    cell = decoder.integer(f"{name}_id")
    return decoder.number(name), cell if cell is not None and cell < N_CELLS else None
