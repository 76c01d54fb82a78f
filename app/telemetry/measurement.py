"""A measurement: what one instant says of the battery, whatever source it came from. Frozen, SI units."""

from dataclasses import dataclass

import numpy as np

from app.estimation.arrays import BoolArray, FloatArray
from app.telemetry.events import Disagreement, Links
from app.telemetry.snapshot import Ages, Charger, Master, Number, ProtectionLimits

STALE_S = 1.0  # older than this, a value is not live
BLANK_S = 10.0  # older than this, a value is not shown
Extreme = tuple[float | None, int | None]  # value and cell


@dataclass(frozen=True, slots=True)
class Reported:
    """Cell figures that the master computes; shown where the cells themselves are missing. None = missing."""

    voltage_v: Number  # 0 where no cell was measured
    voltage_min_v: Extreme
    voltage_max_v: Extreme
    temperature_min_degc: Extreme
    temperature_max_degc: Extreme
    fan_duty: Number
    voltage_error: float = 0.0  # share by which the voltage may be off where a sensor of its own measures it


@dataclass(frozen=True, slots=True)
class Measurement:
    """The newest of every value. Arrays have one element a cell, NaN where missing; None = missing."""

    t_mono_ns: int
    t_wall_ns: int
    uptime_ms: int | None  # the master's clock
    dt_s: float | None  # since the sample before, by the master's clock; None: not known
    is_sample: bool  # new voltages, measured together with the current: a step of the estimator
    is_fresh: bool  # something of it is new; not only older
    current_a: Number  # positive on discharge
    voltage_v: FloatArray
    temperature_degc: FloatArray
    resistance_ohm: FloatArray  # by the master
    capacity_ah: FloatArray  # by the master
    chip_voltage_v: FloatArray  # as the slaves' chips read it, older than voltage_v
    balancing: BoolArray | None
    relays_open: bool  # no current can flow; False while that is not known
    slave_status: tuple[int | None, ...]
    reported: Reported
    master: Master
    charger: Charger
    age_s: Ages
    links: Links
    disagreements: tuple[Disagreement, ...]
    limits: ProtectionLimits | None
    config: bytes | None  # in force, as last received as a whole
    config_hash: str | None
    is_new: BoolArray | None = None  # voltages that came since the sample before; None: all
    was_off: bool = False  # the master may have been without power since the sample before
    awaited: BoolArray | None = None  # cells that were not received yet, and may still come; None: none
    live_s: Ages | None = None  # as long as a value of each part is live; None: STALE_S
    voltage_age_s: FloatArray | None = None  # age of each voltage, where they come one by one; None: as `age_s.voltage`
    step_voltage_v: FloatArray | None = (
        None  # means since the sample before, where the current is one; None: as measured
    )

    @property
    def new_voltage_v(self) -> FloatArray:
        """(n_cells,) voltages that came since the sample before, NaN elsewhere."""
        return self.voltage_v if self.is_new is None else np.where(self.is_new, self.voltage_v, np.nan)

    @property
    def filter_voltage_v(self) -> FloatArray:
        """(n_cells,) what a filter may learn from: new voltages, of the same time as the current."""
        return self.new_voltage_v if self.step_voltage_v is None else self.step_voltage_v
