"""ElCon (TC) chargers on CAN: the command that the BMS sends once a second and the status that comes back.

29-bit ids, big endian, 0.1 V and 0.1 A a count. Without a command for 5 s the charger stops.
Source: the vendor's note on CAN commands; flag bits as used by several Formula Student teams.
"""

import enum
import struct
from dataclasses import dataclass

from firmware_protocol.errors import DecodeError, EncodeError

COMMAND_ID = 0x1806E5F4
STATUS_ID = 0x18FF50E5
COMMAND_PERIOD_S = 1.0
COMMAND_TIMEOUT_S = 5.0
BIT_RATE_6K6 = 500_000  # 1.8 and 3.3 kW chargers: 250 kbit/s
_BODY = struct.Struct(">HHB3x")
_COUNTS_PER_UNIT = 10


class ChargerFlags(enum.IntFlag, boundary=enum.KEEP):
    """Byte 4 of the status; 0 is normal."""

    HARDWARE = 1 << 0
    OVER_TEMPERATURE = 1 << 1
    INPUT_VOLTAGE = 1 << 2
    BATTERY = 1 << 3  # not detected, reversed, or charging disabled
    TIMEOUT = 1 << 4  # no command for 5 s


NORMAL = ChargerFlags(0)


@dataclass(frozen=True, slots=True)
class ChargerCommand:
    """The command to the charger: limits of voltage and current, and whether to charge."""

    voltage_v: float
    current_a: float
    is_charging: bool

    def to_bytes(self) -> bytes:
        """Return the eight data bytes.

        Raises:
            EncodeError: voltage or current outside 0..6553.5.
        """
        return _BODY.pack(
            _counts("voltage_v", self.voltage_v), _counts("current_a", self.current_a), 0 if self.is_charging else 1
        )

    @classmethod
    def from_bytes(cls, data: bytes) -> "ChargerCommand":
        """Parse eight data bytes; any control byte but 0 means stop. DecodeError where they are not eight."""
        voltage, current, control = _unpack("charger command", data)
        return cls(voltage / _COUNTS_PER_UNIT, current / _COUNTS_PER_UNIT, control == 0)


@dataclass(frozen=True, slots=True)
class ChargerStatus:
    """The status of the charger: voltage, current, flags."""

    voltage_v: float
    current_a: float
    flags: ChargerFlags = NORMAL

    def to_bytes(self) -> bytes:
        """Return the eight data bytes.

        Raises:
            EncodeError: voltage or current outside 0..6553.5.
        """
        return _BODY.pack(
            _counts("voltage_v", self.voltage_v), _counts("current_a", self.current_a), int(self.flags) & 0xFF
        )

    @classmethod
    def from_bytes(cls, data: bytes) -> "ChargerStatus":
        """Parse eight data bytes; bits without a meaning are kept. DecodeError where they are not eight."""
        voltage, current, flags = _unpack("charger status", data)
        return cls(voltage / _COUNTS_PER_UNIT, current / _COUNTS_PER_UNIT, ChargerFlags(flags))


def _counts(name: str, value: float) -> int:
    if not 0 <= value <= 0xFFFF / _COUNTS_PER_UNIT:
        raise EncodeError(name, value, f"0..{0xFFFF / _COUNTS_PER_UNIT}")
    return round(value * _COUNTS_PER_UNIT)


def _unpack(what: str, data: bytes) -> tuple[int, int, int]:
    if len(data) != _BODY.size:
        raise DecodeError(what, f"{len(data)} bytes, not {_BODY.size}")
    voltage, current, last = _BODY.unpack(data)
    return voltage, current, last
