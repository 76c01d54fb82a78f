"""The ElCon HK-J 6.6 kW charger as a device: power stage, regulation, its own heat, status messages and faults.

Command bytes and battery voltage come in, current and status bytes go out. It knows nothing of cells or of the master.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from firmware_protocol.elcon import (
    COMMAND_PERIOD_S,
    COMMAND_TIMEOUT_S,
    NORMAL,
    ChargerCommand,
    ChargerFlags,
    ChargerStatus,
)
from firmware_protocol.errors import DecodeError

_TIME_TOLERANCE_S = 1e-9


@dataclass(frozen=True)
class ChargerParameters:
    """Limits of the charger."""

    max_power_w: float = 6600.0
    max_voltage_v: float = 440.0
    max_current_a: float = 18.0
    min_battery_v: float = 60.0  # below, no battery is detected
    ramp_up_a_per_s: float = 2.0
    ramp_down_a_per_s: float = 20.0
    lag_s: float = 0.15  # time constant of the current loop
    loop_ohm: float = 0.6  # what the voltage loop takes the battery's resistance for; stable up to twice that and more
    voltage_gain: float = 1.001  # gain error of its own measurement
    efficiency: float = 0.93
    heat_capacity_j_per_k: float = 4000.0
    cooling_w_per_k: float = 12.0
    derating_degc: float = 75.0
    shutdown_degc: float = 90.0
    restart_degc: float = 70.0


class ChargerUnit:
    """One charger. `current_a` is what it gives, positive INTO the battery.

    Faults to be set from outside: `has_mains`, `is_reversed`, `is_silent` (sends nothing, receives nothing),
    `has_hardware_fault`, `extra_heat_w` (a blocked fan of its own).
    """

    def __init__(self, parameters: ChargerParameters | None = None, *, ambient_degc: float = 25.0) -> None:
        self.parameters = parameters or ChargerParameters()
        self.ambient_degc = ambient_degc
        self.temperature_degc = ambient_degc
        self.current_a = 0.0
        self.voltage_v = 0.0
        self.has_mains = True
        self.is_reversed = False
        self.is_silent = False
        self.has_hardware_fault = False
        self.extra_heat_w = 0.0
        self._command = ChargerCommand(0.0, 0.0, is_charging=False)
        self._since_command_s = math.inf
        self._since_status_s = 0.0
        self._is_overheated = False

    @property
    def flags(self) -> ChargerFlags:
        """The fault flags of the status message."""
        flags = NORMAL
        if self.has_hardware_fault:
            flags |= ChargerFlags.HARDWARE
        if self._is_overheated:
            flags |= ChargerFlags.OVER_TEMPERATURE
        if not self.has_mains:
            flags |= ChargerFlags.INPUT_VOLTAGE
        if self.is_reversed or self.voltage_v < self.parameters.min_battery_v:
            flags |= ChargerFlags.BATTERY
        if self._since_command_s > COMMAND_TIMEOUT_S:
            flags |= ChargerFlags.TIMEOUT
        return flags

    def receive(self, data: bytes) -> bool:
        """Take the eight data bytes of a command; return whether it was one. A silent unit ignores it."""
        if self.is_silent:
            return False
        try:
            self._command = ChargerCommand.from_bytes(data)
        except DecodeError:
            return False
        self._since_command_s = 0.0
        return True

    def step(self, dt_s: float, battery_v: float) -> bytes | None:
        """Advance by `dt_s` at the voltage `battery_v` of its plug and return status bytes when they are due.

        The current follows the least of the commanded current, the current that holds the commanded voltage, and the
        power limit, through a ramp and a first-order lag; steps of any length are stable.
        """
        self._since_command_s += dt_s
        self.voltage_v = 0.0 if self.is_reversed else max(battery_v, 0.0)
        self._heat(dt_s)
        wanted_a = self._wanted_a()
        change_a = (wanted_a - self.current_a) * -math.expm1(-dt_s / self.parameters.lag_s)
        rise_a, fall_a = self.parameters.ramp_up_a_per_s * dt_s, self.parameters.ramp_down_a_per_s * dt_s
        self.current_a += min(max(change_a, -fall_a), rise_a)
        if self.flags:
            self.current_a = 0.0
        return self._status_if_due(dt_s)

    def status(self) -> ChargerStatus:
        """Return the status message of the unit."""
        return ChargerStatus(self.voltage_v * self.parameters.voltage_gain, self.current_a, self.flags)

    def _wanted_a(self) -> float:
        p, command = self.parameters, self._command
        if self.flags or not command.is_charging:
            return 0.0
        # From the last current, by the voltage that is missing over an assumed battery resistance.
        missing_v = min(command.voltage_v, p.max_voltage_v) - self.voltage_v * p.voltage_gain
        holding_a = self.current_a + missing_v / p.loop_ohm
        power_w = p.max_power_w
        if self.temperature_degc > p.derating_degc:
            power_w *= max(0.0, 1.0 - (self.temperature_degc - p.derating_degc) / (p.shutdown_degc - p.derating_degc))
        limit_a = min(command.current_a, p.max_current_a, power_w / max(self.voltage_v, p.min_battery_v))
        return min(max(holding_a, 0.0), limit_a)

    def _heat(self, dt_s: float) -> None:
        p = self.parameters
        lost_w = self.current_a * self.voltage_v * (1.0 / p.efficiency - 1.0) + self.extra_heat_w
        settled_degc = self.ambient_degc + lost_w / p.cooling_w_per_k
        left = math.exp(-dt_s * p.cooling_w_per_k / p.heat_capacity_j_per_k)
        self.temperature_degc = settled_degc + (self.temperature_degc - settled_degc) * left
        if self.temperature_degc >= p.shutdown_degc:
            self._is_overheated = True
        elif self.temperature_degc < p.restart_degc:
            self._is_overheated = False

    def _status_if_due(self, dt_s: float) -> bytes | None:
        self._since_status_s += dt_s
        if self._since_status_s < COMMAND_PERIOD_S - _TIME_TOLERANCE_S:
            return None
        self._since_status_s = math.fmod(self._since_status_s, COMMAND_PERIOD_S)
        if COMMAND_PERIOD_S - self._since_status_s < _TIME_TOLERANCE_S:
            self._since_status_s = 0.0
        return None if self.is_silent else self.status().to_bytes()
