"""The vehicle's side of the relays: the inverter's link capacitor, its pre-charge, its leak and its discharge.

The accumulator's voltage and the relays' state come in, the current that the link draws goes out. Exact for a voltage
that is constant over the step, so no step length is unstable.
"""

import math
from dataclasses import dataclass

from simulator.bms_state import RelayState


@dataclass(frozen=True)
class LinkParameters:
    """Of a car with two inverters; 0.3 s to charge, below 60 V 2.9 s after opening (rules: 5 s)."""

    capacitance_f: float = 500e-6
    precharge_ohm: float = 600.0
    discharge_ohm: float = 3000.0  # switched in while the relays are open


class LinkCircuit:
    """One capacitor. Faults to be set: `leak_ohm`, `is_precharge_open`, `is_discharge_open`."""

    def __init__(self, parameters: LinkParameters | None = None) -> None:
        self.parameters = parameters or LinkParameters()
        self.voltage_v = 0.0
        self.leak_ohm = math.inf  # across the capacitor: wet connector, a load that is on too early
        self.is_precharge_open = False
        self.is_discharge_open = False

    def step(self, dt_s: float, source_v: float, relays: RelayState) -> float:
        """Advance by `dt_s` > 0 [s] and return the mean current out of the accumulator [A].

        Into C over R from V, with a leak L across C: V settles at V L / (R + L) with the time constant C R L / (R + L).
        """
        leak_s = 1.0 / self.leak_ohm
        if relays is RelayState.VEHICLE:
            self.voltage_v = source_v
            return source_v * leak_s
        is_charging = relays is RelayState.PRECHARGE and not self.is_precharge_open
        is_discharging = relays is not RelayState.PRECHARGE and not self.is_discharge_open
        feed_s = 1.0 / self.parameters.precharge_ohm if is_charging else 0.0
        total_s = leak_s + feed_s + (1.0 / self.parameters.discharge_ohm if is_discharging else 0.0)
        if not total_s:
            return 0.0
        settled_v = source_v * feed_s / total_s
        exponent = dt_s * total_s / self.parameters.capacitance_f
        away_v = self.voltage_v - settled_v
        self.voltage_v = settled_v + away_v * math.exp(-exponent)
        mean_v = settled_v + away_v * -math.expm1(-exponent) / exponent
        return (source_v - mean_v) * feed_s
