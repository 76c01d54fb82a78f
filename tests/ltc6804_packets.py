"""LTC6804-2 packets as a master writes and reads them, in the words of the data sheet, for tests of slaves and of C."""

from dataclasses import dataclass

from firmware_protocol.ltc6804 import AdcMode, with_pec

VOLTS_PER_COUNT = 1e-4
THRESHOLD_STEP_V = 1.6e-3


def adcv(mode: AdcMode = AdcMode.NORMAL, *, discharge_permitted: bool = False, channel: int = 0) -> int:
    """The command that converts cells: channel 0 all twelve, 1..6 cells n and n + 6."""
    return 0x260 | mode << 7 | discharge_permitted << 4 | channel


def adax(mode: AdcMode = AdcMode.NORMAL, channel: int = 0) -> int:
    """The command that converts GPIO: channel 0 all and the reference, 1..5 one GPIO, 6 the reference."""
    return 0x460 | mode << 7 | channel


def adstat(mode: AdcMode = AdcMode.NORMAL, channel: int = 0) -> int:
    """The command that converts status: channel 0 all, 1 sum of cells, 2 die temperature, 3 and 4 supplies."""
    return 0x468 | mode << 7 | channel


def command_packet(command: int, address: int | None = None) -> bytes:
    """The four bytes that start a packet, to one chip or (without an address) to all."""
    first = command >> 8 if address is None else 0x80 | address << 3 | command >> 8
    return with_pec(bytes((first, command & 0xFF)))


def write_packet(command: int, data: bytes, address: int | None = None) -> bytes:
    """A whole write packet of 12 bytes."""
    return command_packet(command, address) + with_pec(data)


def decode_words(data: bytes) -> tuple[int | None, ...]:
    """The three counts of 100 uV in a voltage group; None where the chip holds no measurement."""
    words = (int.from_bytes(data[at : at + 2], "little") for at in (0, 2, 4))
    return tuple(None if word == 0xFFFF else word for word in words)


def flags_of(bits: int, n: int) -> tuple[bool, ...]:
    return tuple(bool(bits >> i & 1) for i in range(n))


def bits_of(flags: tuple[bool, ...]) -> int:
    return sum(1 << i for i, is_set in enumerate(flags) if is_set)


@dataclass(frozen=True, slots=True)
class Configuration:
    """The CFGR group; the default has the reference on, as the master uses it."""

    gpio_pull_down_off: tuple[bool, ...] = (True,) * 5  # GPIO1 first
    reference_on: bool = True
    software_timer_enabled: bool = False
    adc_option: bool = False
    under_voltage_code: int = 0
    over_voltage_code: int = 0
    discharging: tuple[bool, ...] = (False,) * 12
    discharge_timer_code: int = 0

    @property
    def under_voltage_v(self) -> float:
        return (self.under_voltage_code + 1) * THRESHOLD_STEP_V

    @property
    def over_voltage_v(self) -> float:
        return self.over_voltage_code * THRESHOLD_STEP_V

    def to_bytes(self) -> bytes:
        first = bits_of((self.adc_option, self.software_timer_enabled, self.reference_on, *self.gpio_pull_down_off))
        codes = self.over_voltage_code << 12 | self.under_voltage_code
        cells = self.discharge_timer_code << 12 | bits_of(self.discharging)
        return bytes([first]) + codes.to_bytes(3, "little") + cells.to_bytes(2, "little")

    @classmethod
    def from_bytes(cls, data: bytes) -> "Configuration":
        adc_option, timer, reference, *gpio = flags_of(data[0], 8)
        codes, cells = int.from_bytes(data[1:4], "little"), int.from_bytes(data[4:6], "little")
        flags = tuple(gpio), reference, timer, adc_option
        return cls(*flags, codes & 0xFFF, codes >> 12, flags_of(cells, 12), cells >> 12)


@dataclass(frozen=True, slots=True)
class StatusA:
    """The STATA group in counts."""

    sum_of_cells: int | None
    die_temperature: int | None
    analog_supply: int | None

    @property
    def total_v(self) -> float | None:
        return None if self.sum_of_cells is None else self.sum_of_cells * 20 * VOLTS_PER_COUNT

    @property
    def die_degc(self) -> float | None:
        return None if self.die_temperature is None else self.die_temperature * VOLTS_PER_COUNT / 7.5e-3 - 273

    @classmethod
    def from_bytes(cls, data: bytes) -> "StatusA":
        return cls(*decode_words(data))


@dataclass(frozen=True, slots=True)
class StatusB:
    """The STATB group: digital supply [100 uV], two flags for each cell, and the state of the chip itself."""

    digital_supply: int | None
    under_voltage: tuple[bool, ...]
    over_voltage: tuple[bool, ...]
    revision: int
    multiplexer_failed: bool
    thermal_shutdown: bool

    @classmethod
    def from_bytes(cls, data: bytes) -> "StatusB":
        pairs = flags_of(int.from_bytes(data[2:5], "little"), 24)
        return cls(decode_words(data)[0], pairs[::2], pairs[1::2], data[5] >> 4, bool(data[5] & 2), bool(data[5] & 1))
