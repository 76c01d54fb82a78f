"""LTC6804-2 packets: commands with PEC15, register groups to dataclasses and back.

A packet is the command (2 bytes), its PEC15, and for reads and writes 6 data bytes with a PEC15 of their own, most
significant byte first; register values inside the data are low byte first. Source: the LTC6804 data sheet.
"""

import enum
import struct
from dataclasses import dataclass, field

from firmware_protocol.errors import DecodeError, EncodeError
from firmware_protocol.memory_map import CELLS_PER_PACK, CHIP_MISSING

GROUP_SIZE = 6
PEC_SIZE = 2
PEC15_SEED = 0x0010
PEC15_POLYNOMIAL = 0x4599
N_ADDRESSES = 16
VOLTS_PER_COUNT = 1e-4
UNDER_VOLTAGE_STEP_V = 1.6e-3  # threshold = (vuv + 1) steps
OVER_VOLTAGE_STEP_V = 1.6e-3  # threshold = vov steps
DISCHARGE_MINUTES = (0, 0.5, 1, 2, 3, 4, 5, 10, 15, 20, 30, 40, 60, 75, 90, 120)  # by DCTO code; 0 = no timer
_THREE_WORDS = struct.Struct("<3H")


class Command(enum.IntEnum):
    """Command codes of 11 bits; conversions are made by `adcv`, `adax` and `adstat`."""

    WRCFG = 0x001
    RDCFG = 0x002
    RDCVA = 0x004
    RDCVB = 0x006
    RDCVC = 0x008
    RDCVD = 0x00A
    RDAUXA = 0x00C
    RDAUXB = 0x00E
    RDSTATA = 0x010
    RDSTATB = 0x012
    CLRCELL = 0x711
    CLRAUX = 0x712
    CLRSTAT = 0x713
    PLADC = 0x714
    DIAGN = 0x715
    WRCOMM = 0x721
    RDCOMM = 0x722
    STCOMM = 0x723


READ_CELLS = (Command.RDCVA, Command.RDCVB, Command.RDCVC, Command.RDCVD)


class AdcMode(enum.IntEnum):
    """Conversion speed; in brackets with CFGR's adcopt set."""

    FAST = 1  # 27 kHz (14 kHz)
    NORMAL = 2  # 7 kHz (3 kHz)
    FILTERED = 3  # 26 Hz (2 kHz)


def adcv(mode: AdcMode = AdcMode.NORMAL, *, discharge_permitted: bool = False, channel: int = 0) -> int:
    """Return the command that converts cells: channel 0 all twelve, 1..6 cells n and n + 6.

    Raises:
        EncodeError: the channel is outside 0..6.
    """
    return 0x260 | mode << 7 | discharge_permitted << 4 | _channel(channel)


def adax(mode: AdcMode = AdcMode.NORMAL, channel: int = 0) -> int:
    """Return the command that converts GPIO: channel 0 all and the reference, 1..5 one GPIO, 6 the reference.

    Raises:
        EncodeError: the channel is outside 0..6.
    """
    return 0x460 | mode << 7 | _channel(channel)


def adstat(mode: AdcMode = AdcMode.NORMAL, channel: int = 0) -> int:
    """Return the command that converts status: channel 0 all, 1 sum of cells, 2 die temperature, 3 and 4 supplies.

    Raises:
        EncodeError: the channel is outside 0..4.
    """
    return 0x468 | mode << 7 | _channel(channel, highest=4)


def _channel(channel: int, highest: int = 6) -> int:
    if not 0 <= channel <= highest:
        raise EncodeError("channel", channel, f"0..{highest}")
    return channel


def _pec15_entry(byte: int) -> int:
    remainder = byte << 7
    for _ in range(8):
        remainder = remainder << 1 ^ (PEC15_POLYNOMIAL if remainder & 0x4000 else 0)
    return remainder & 0x7FFF


_PEC15_TABLE = tuple(_pec15_entry(byte) for byte in range(256))


def pec15(data: bytes) -> int:
    """Return the 16-bit word that follows `data` on the bus: the 15-bit PEC and a 0."""
    remainder = PEC15_SEED
    for byte in data:
        remainder = (remainder << 8 ^ _PEC15_TABLE[remainder >> 7 & 0xFF ^ byte]) & 0x7FFF
    return remainder << 1


def with_pec(data: bytes) -> bytes:
    """Return `data` and its PEC15."""
    return data + pec15(data).to_bytes(PEC_SIZE, "big")


def command_packet(command: int, address: int | None = None) -> bytes:
    """Return the four bytes that start a packet, to one chip or (without an address) to all.

    Raises:
        EncodeError: the command does not fit 11 bits or the address 4.
    """
    if not 0 <= command <= 0x7FF:
        raise EncodeError("command", command, "0..0x7ff")
    if address is not None and not 0 <= address < N_ADDRESSES:
        raise EncodeError("address", address, f"0..{N_ADDRESSES - 1}")
    first = command >> 8 if address is None else 0x80 | address << 3 | command >> 8
    return with_pec(bytes((first, command & 0xFF)))


def decode_command(packet: bytes) -> tuple[int, int | None]:
    """Return (command, address) of a packet's first four bytes; the address is None in a broadcast.

    Raises:
        DecodeError: fewer than four bytes, a wrong PEC, or address bits in a broadcast.
    """
    if len(packet) < 4:
        raise DecodeError("LTC6804 command", f"{len(packet)} bytes, at least 4")
    if with_pec(packet[:2]) != packet[:4]:
        raise DecodeError("LTC6804 command", "PEC", 2)
    command = (packet[0] & 0x07) << 8 | packet[1]
    if packet[0] & 0x80:
        return command, packet[0] >> 3 & 0x0F
    if packet[0] > 0x07:
        raise DecodeError("LTC6804 command", "address bits without the address mark", 0)
    return command, None


def write_packet(command: int, data: bytes, address: int | None = None) -> bytes:
    """Return a whole write packet of 12 bytes.

    Raises:
        EncodeError: not six data bytes, or a command or address that does not fit.
    """
    if len(data) != GROUP_SIZE:
        raise EncodeError("data", f"{len(data)} bytes", f"{GROUP_SIZE} bytes")
    return command_packet(command, address) + with_pec(data)


def decode_group(reply: bytes) -> bytes:
    """Return the six data bytes of a chip's answer.

    Raises:
        DecodeError: not eight bytes, or a wrong PEC.
    """
    if len(reply) != GROUP_SIZE + PEC_SIZE:
        raise DecodeError("LTC6804 register group", f"{len(reply)} bytes, not {GROUP_SIZE + PEC_SIZE}")
    if with_pec(reply[:GROUP_SIZE]) != reply:
        raise DecodeError("LTC6804 register group", "PEC", GROUP_SIZE)
    return reply[:GROUP_SIZE]


def encode_words(words: tuple[int | None, int | None, int | None]) -> bytes:
    """Return a voltage group (CVA..CVD, AUXA, AUXB) of three counts of 100 uV; None is written as 0xFFFF."""
    return _THREE_WORDS.pack(*(CHIP_MISSING if word is None else word for word in words))


def decode_words(data: bytes) -> tuple[int | None, int | None, int | None]:
    """Return the three counts of 100 uV in a voltage group; None where the chip holds no measurement (0xFFFF).

    Raises:
        DecodeError: not six bytes.
    """
    first, second, third = _THREE_WORDS.unpack(_group(data))
    return _missing(first), _missing(second), _missing(third)


def _missing(word: int) -> int | None:
    return None if word == CHIP_MISSING else word


def _group(data: bytes) -> bytes:
    if len(data) != GROUP_SIZE:
        raise DecodeError("LTC6804 register group", f"{len(data)} bytes, not {GROUP_SIZE}")
    return data


@dataclass(frozen=True, slots=True)
class Configuration:
    """The CFGR group; `discharging` has one entry a cell. The default has the reference on, as the master uses it."""

    gpio_pull_down_off: tuple[bool, bool, bool, bool, bool] = (True,) * 5  # GPIO1 first
    reference_on: bool = True
    software_timer_enabled: bool = False  # read only
    adc_option: bool = False
    under_voltage_code: int = 0  # 12 bits
    over_voltage_code: int = 0  # 12 bits
    discharging: tuple[bool, ...] = field(default=(False,) * CELLS_PER_PACK)
    discharge_timer_code: int = 0  # index into DISCHARGE_MINUTES

    @property
    def under_voltage_v(self) -> float:
        """The under-voltage threshold [V]."""
        return (self.under_voltage_code + 1) * UNDER_VOLTAGE_STEP_V

    @property
    def over_voltage_v(self) -> float:
        """The over-voltage threshold [V]."""
        return self.over_voltage_code * OVER_VOLTAGE_STEP_V

    def to_bytes(self) -> bytes:
        """Return CFGR0..CFGR5.

        Raises:
            EncodeError: a code that does not fit, or not twelve cells.
        """
        for name, code, end in (
            ("under_voltage_code", self.under_voltage_code, 1 << 12),
            ("over_voltage_code", self.over_voltage_code, 1 << 12),
            ("discharge_timer_code", self.discharge_timer_code, len(DISCHARGE_MINUTES)),
        ):
            if not 0 <= code < end:
                raise EncodeError(name, code, f"0..{end - 1}")
        if len(self.discharging) != CELLS_PER_PACK:
            raise EncodeError("discharging", len(self.discharging), f"{CELLS_PER_PACK} cells")
        cells = _bits(self.discharging)
        flags = self.reference_on << 2 | self.software_timer_enabled << 1 | self.adc_option
        return bytes(
            (
                _bits(self.gpio_pull_down_off) << 3 | flags,
                self.under_voltage_code & 0xFF,
                (self.over_voltage_code & 0x0F) << 4 | self.under_voltage_code >> 8,
                self.over_voltage_code >> 4,
                cells & 0xFF,
                self.discharge_timer_code << 4 | cells >> 8,
            )
        )

    @classmethod
    def from_bytes(cls, data: bytes) -> "Configuration":
        """Parse CFGR0..CFGR5; DecodeError where they are not six bytes."""
        c0, c1, c2, c3, c4, c5 = _group(data)
        gpio = tuple(bool(c0 >> 3 + i & 1) for i in range(5))
        return cls(
            (gpio[0], gpio[1], gpio[2], gpio[3], gpio[4]),
            bool(c0 & 4),
            bool(c0 & 2),
            bool(c0 & 1),
            (c2 & 0x0F) << 8 | c1,
            c3 << 4 | c2 >> 4,
            tuple(bool((c5 << 8 | c4) >> i & 1) for i in range(CELLS_PER_PACK)),
            c5 >> 4,
        )


def _bits(flags: tuple[bool, ...]) -> int:
    return sum(1 << i for i, is_set in enumerate(flags) if is_set)


@dataclass(frozen=True, slots=True)
class StatusA:
    """The STATA group in counts; the properties give units, None where the chip holds no measurement."""

    sum_of_cells: int | None
    die_temperature: int | None
    analog_supply: int | None

    @property
    def total_v(self) -> float | None:
        """The sum of the cells [V]: 20 times 100 uV a count."""
        return None if self.sum_of_cells is None else self.sum_of_cells * 20 * VOLTS_PER_COUNT

    @property
    def die_degc(self) -> float | None:
        """The chip's temperature [degC]: 7.5 mV/K, from absolute zero."""
        return None if self.die_temperature is None else self.die_temperature * VOLTS_PER_COUNT / 7.5e-3 - 273

    def to_bytes(self) -> bytes:
        """Return the group's six bytes."""
        return encode_words((self.sum_of_cells, self.die_temperature, self.analog_supply))

    @classmethod
    def from_bytes(cls, data: bytes) -> "StatusA":
        """Parse the group; DecodeError where it is not six bytes."""
        return cls(*decode_words(data))


@dataclass(frozen=True, slots=True)
class StatusB:
    """The STATB group: digital supply [100 uV], two flags for each cell, and the state of the chip itself."""

    digital_supply: int | None
    under_voltage: tuple[bool, ...]
    over_voltage: tuple[bool, ...]
    revision: int = 0
    multiplexer_failed: bool = False
    thermal_shutdown: bool = False

    def to_bytes(self) -> bytes:
        """Return the group's six bytes."""
        pairs = [flag for pair in zip(self.under_voltage, self.over_voltage, strict=True) for flag in pair]
        supply = CHIP_MISSING if self.digital_supply is None else self.digital_supply
        last = self.revision << 4 | self.multiplexer_failed << 1 | self.thermal_shutdown
        return supply.to_bytes(2, "little") + _bits(tuple(pairs)).to_bytes(3, "little") + bytes((last,))

    @classmethod
    def from_bytes(cls, data: bytes) -> "StatusB":
        """Parse the group; DecodeError where it is not six bytes."""
        supply = int.from_bytes(_group(data)[:2], "little")
        pairs = int.from_bytes(data[2:5], "little")
        return cls(
            _missing(supply),
            tuple(bool(pairs >> 2 * cell & 1) for cell in range(CELLS_PER_PACK)),
            tuple(bool(pairs >> 2 * cell + 1 & 1) for cell in range(CELLS_PER_PACK)),
            data[5] >> 4,
            bool(data[5] & 2),
            bool(data[5] & 1),
        )


# The temperature sensor inside an Energus module: its voltage at a temperature, linear between the 33 points that
# Energus publishes, -40 to 120 degC in steps of 5 K. The curve falls: 12 mV/K at 25 degC, 1 to 2 mV/K at its ends.
SENSOR_FIRST_DEGC = -40
SENSOR_STEP_DEGC = 5
# fmt: off
SENSOR_POINTS_V = (
    2.44, 2.42, 2.40, 2.38, 2.35, 2.32, 2.27, 2.23,  # -40 to -5 degC
    2.17, 2.11, 2.05, 1.99, 1.92, 1.86, 1.80, 1.74,  # 0 to 35
    1.68, 1.63, 1.59, 1.55, 1.51, 1.48, 1.45, 1.43,  # 40 to 75
    1.40, 1.38, 1.37, 1.35, 1.34, 1.33, 1.32, 1.31, 1.30,  # 80 to 120
)
# fmt: on
SENSOR_MARGIN_V = 0.005  # half of the table's last digit
