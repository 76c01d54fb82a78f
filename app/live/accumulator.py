"""The accumulator as a whole: from the cells, or from the master's own fields where cells are missing."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from app.estimation.arrays import holds_all
from app.live.cells import extreme, mean, mean_of_all
from app.telemetry import Accumulator, Cells, FloatArray, LowestUnderLoad
from app.telemetry.measurement import Measurement, Reported

LOAD_A = 1.0  # below it, next to nothing flows
DRAWN_A = 5.0  # the car drives: neither its own supply nor the sensor's offset
REPORT_SLACK = 0.997  # relative slack of a total for rounding
DRIVE_ENDS_NS = 600_000_000_000  # without such a current for longer, the next drive begins; a driver change is shorter


@dataclass
class EnergyCount:
    """Energy that flowed; where a cell was missing under load, at least this."""

    out_wh: float = 0.0
    in_wh: float = 0.0
    gap_s: float = 0.0

    def step(self, dt_s: float, current_a: float, cells_v: FloatArray, total_v: float | None) -> None:
        """Take what flowed in a step: at the voltage of all cells, or at that of those that were measured."""
        energy_wh = current_a * (float(np.nansum(cells_v)) if total_v is None else total_v) * dt_s / 3600
        self.out_wh += max(energy_wh, 0.0)
        self.in_wh += max(-energy_wh, 0.0)
        if total_v is None and abs(current_a) > LOAD_A:
            self.gap_s += dt_s


class LowestOfDrive:
    """The lowest cell voltage under load since the last drive began; it stays until the next one begins."""

    def __init__(self) -> None:
        self.lowest: LowestUnderLoad | None = None
        self._drawn_ns: int | None = None  # when current was last drawn

    def step(self, t_mono_ns: int, t_wall_ns: int, current_a: float, new_voltage_v: FloatArray) -> None:
        """Take the voltages that were measured with a current."""
        if current_a < DRAWN_A:
            return
        if self._drawn_ns is None or t_mono_ns - self._drawn_ns > DRIVE_ENDS_NS:
            self.lowest = None
        self._drawn_ns = t_mono_ns
        voltage_v, cell = extreme(new_voltage_v, highest=False)
        if voltage_v is not None and cell is not None and (self.lowest is None or voltage_v < self.lowest.voltage_v):
            self.lowest = LowestUnderLoad(voltage_v, cell, current_a, t_wall_ns)


def total_voltage(cells_v: FloatArray, reported: Reported) -> float | None:
    """Voltage of all cells: as reported or their sum; None where a cell is missing in both.

    Where only the report is there, it holds all cells if it is at least what as many of the lowest would have.
    """
    total_v, lowest_v = reported.voltage_v, reported.voltage_min_v[0]
    is_alone = np.isnan(cells_v).all()
    least_v = REPORT_SLACK * cells_v.size * lowest_v if is_alone and lowest_v is not None else 0.0
    if total_v and total_v >= least_v and holds_all(total_v, cells_v):  # 0 V: no cell was measured
        return total_v
    return None if math.isnan(total := float(cells_v.sum())) else total


def accumulator_of(
    cells: Cells,
    measured: Measurement,
    driver_percent: int | None,
    energy: EnergyCount,
    lowest: LowestUnderLoad | None = None,
) -> Accumulator:
    """Voltage, current, power, charge, the extremes with their cell, and the energy that flowed since the start."""
    reported, current_a = measured.reported, measured.current_a
    voltage_v = total_voltage(cells.voltage_v, reported)
    least_v = float(np.nansum(cells.voltage_v)) or reported.voltage_v or None
    loaded = int((~np.isnan(cells.voltage_v)).sum())
    is_partial = 0 < loaded < len(cells.voltage_v)
    low_v, low_cell = extreme(cells.voltage_v, highest=False)
    high_v, high_cell = extreme(cells.voltage_v, highest=True)
    if low_v is None:
        low_v, low_cell = reported.voltage_min_v
        high_v, high_cell = reported.voltage_max_v
    cold, cold_cell = extreme(cells.temperature_degc, highest=False)
    hot, hot_cell = extreme(cells.temperature_degc, highest=True)
    if hot is None:
        cold, cold_cell = reported.temperature_min_degc
        hot, hot_cell = reported.temperature_max_degc
    return Accumulator(
        voltage_v=voltage_v,
        current_a=current_a,
        power_w=None if voltage_v is None or current_a is None else voltage_v * current_a,
        voltage_min_v=low_v,
        voltage_min_cell=low_cell,
        voltage_max_v=high_v,
        voltage_max_cell=high_cell,
        voltage_mean_v=mean_of_all(cells.voltage_v),
        voltage_delta_v=None if is_partial or low_v is None or high_v is None else high_v - low_v,
        temperature_min_degc=cold,
        temperature_min_cell=cold_cell,
        temperature_max_degc=hot,
        temperature_max_cell=hot_cell,
        temperature_mean_degc=mean(cells.temperature_degc),
        loaded_cells=loaded,
        energy_out_wh=energy.out_wh,
        energy_in_wh=energy.in_wh,
        fan_duty=reported.fan_duty,
        voltage_at_least_v=least_v if voltage_v is None else None,
        energy_gap_s=energy.gap_s or None,
        lowest_under_load=lowest,
        **charge_of(cells.soc, cells.soc_sigma, driver_percent, measured.master.soc),
    )


def charge_of(
    soc: FloatArray, sigma: FloatArray, driver_percent: int | None, master_soc: float | None
) -> dict[str, Any]:
    """Fields of Accumulator: the estimated SOC of the cells, else the master's own, and which of the two it is."""
    low, low_cell = extreme(soc, highest=False)
    high, high_cell = extreme(soc, highest=True)
    average, source = mean_of_all(soc), "filter"
    if average is None:
        average, source = master_soc, "master"
        # 0.29 is 28.999... hundredths
        driver_percent = None if average is None else math.floor(average * 100 + 1e-9)
    return {
        "soc": average,
        "soc_source": None if average is None else source,
        "soc_sigma": mean_of_all(sigma),
        "driver_soc_percent": driver_percent,
        "soc_min": low,
        "soc_min_cell": low_cell,
        "soc_max": high,
        "soc_max_cell": high_cell,
        "soc_spread": None if low is None or high is None or np.isnan(soc).any() else high - low,
    }
