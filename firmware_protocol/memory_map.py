"""The master's struct as a table: the only place where a field's place, unit, range and default exist.

Everything else derives from it: the numpy view, the configuration form, the CAN byte picker, the DBC, the C header.
Source: the debugger view and the tables of the 2021 master's documentation; rows marked "ours" are not in it.
"""

import bisect
import hashlib
import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace

N_PACKS = 8
CELLS_PER_PACK = 12
N_CELLS = N_PACKS * CELLS_PER_PACK
N_CAN_MESSAGES = 8
CAN_DATA_BYTES = 8
BYTE_UNUSED = 0xFFFF  # a CAN table entry: send 0, ignore on receipt
CAN_ID_EXTENDED = 1 << 31  # in a table's id: this is a 29-bit id
NO_RESPONSE = 0xFF
RESPONSE_CHARGES = 0x40  # added to a response: charging begins with the message and ends with its silence
CURRENT_BUFFER = 200  # samples of the current that the converter's buffer takes
BASE_ADDRESS = 0x200005A8  # where the debugger view found the struct


@dataclass(frozen=True, slots=True)
class Field:
    """One field of a struct; `scale` and `unit` give the physical value of one count."""

    name: str
    offset: int  # bytes from the start of its struct
    fmt: str  # struct code of one element: b B h H i I
    shape: tuple[int, ...] = ()
    unit: str = ""
    scale: float = 1.0
    minimum: int | None = None  # raw counts, inclusive; None where the master writes it itself
    maximum: int | None = None
    default: int | tuple[int, ...] | None = None
    group: str = ""
    meaning: str = ""
    is_live: bool = False  # may be changed while the car drives or charges

    @property
    def count(self) -> int:
        """Number of elements over all dimensions."""
        n = 1
        for length in self.shape:
            n *= length
        return n

    @property
    def item_size(self) -> int:
        """Bytes of one element."""
        return struct.calcsize(self.fmt)

    @property
    def size(self) -> int:
        """Bytes of the whole field."""
        return self.item_size * self.count

    @property
    def end(self) -> int:
        """First offset after the field."""
        return self.offset + self.size

    def unpack(self, image: bytes | bytearray | memoryview, base: int = 0) -> tuple[int, ...]:
        """Return the raw elements out of an image whose struct starts at `base`."""
        return struct.unpack_from(f"<{self.count}{self.fmt}", image, base + self.offset)

    def pack_into(self, image: bytearray, values: tuple[int, ...], base: int = 0) -> None:
        """Write all raw elements into an image whose struct starts at `base`."""
        struct.pack_into(f"<{self.count}{self.fmt}", image, base + self.offset, *values)


_U16 = 0xFFFF
_I16 = 0x7FFF

# fmt: off
_TX_IDS = (0x1806E5F4 | CAN_ID_EXTENDED, 0x100, 0x101, 0, 0, 0, 0, 0)
_RX_IDS = (0x18FF50E5 | CAN_ID_EXTENDED, 0, 0, 0, 0, 0, 0, 0)
_UNUSED_ROW = (BYTE_UNUSED,) * CAN_DATA_BYTES
# charger command, big endian on the bus: v_set, i_set, control
_TX_CHARGER = (429, 428, 431, 430, 436, _U16, _U16, _U16)
# ECU summary: soc, v_tot, i_fs
_TX_ECU = (2982, 2983, 2288, 2289, 1884, 1885, 1886, 1887)
# cell extremes: v_min, v_max, v_min_id, v_max_id, t_max, the first eight status flags
_TX_EXTREMES = (2280, 2281, 2282, 2283, 2286, 2287, 2387, 420)
_TX_DATA = _TX_CHARGER + _TX_ECU + _TX_EXTREMES + _UNUSED_ROW * 5
# charger status: v_out, i_out, flags
_RX_DATA = (433, 432, 435, 434, 437, _U16, _U16, _U16) + _UNUSED_ROW * 7

CONFIG_FIELDS = (
    Field("ts", 0, "H", (), "sample", 1, 1, CURRENT_BUFFER, 100, "sampling", "1 kHz samples per mean of the current; sets the rate of current, overcurrent protection and charge count"),
    Field("v_cell_min", 2, "H", (), "V", 1e-4, 15000, 40000, 25000, "cell limits", "lowest cell voltage; below it the master opens the contactors"),
    Field("v_cell_max", 4, "H", (), "V", 1e-4, 30000, 45000, 42000, "cell limits", "highest cell voltage; above it the master opens the contactors"),
    Field("v_cell_chrg", 6, "H", (), "V", 1e-4, 30000, 45000, 41500, "charging", "charge until the first cell reaches this voltage"),
    Field("t_cell_min", 8, "b", (), "degC", 1, -40, 40, -15, "cell limits", "lowest cell temperature"),
    Field("t_cell_max", 9, "b", (), "degC", 1, 0, 100, 45, "cell limits", "highest cell temperature; the rules allow 60 degC or the data sheet's limit"),
    Field("i_offset", 10, "H", (), "count", 0.1, 0, 40950, 20490, "current sensor", "ADC reading at no current, in tenths of a count"),
    Field("i_gain", 12, "H", (), "A/count", 2e-5, 1, _U16, 12120, "current sensor", "amperes per ADC count: i[10 mA] = (10 count - i_offset) i_gain / 5000"),
    Field("i_disc_min", 14, "h", (), "A", 0.01, -_I16, 0, -10000, "current limits", "highest regen current while driving (negative)"),
    Field("i_disc_max", 16, "h", (), "A", 0.01, 0, _I16, 20000, "current limits", "highest discharge current while driving"),
    Field("i_chrg_min", 18, "h", (), "A", 0.01, -_I16, _I16, 0, "current limits", "lowest current while charging"),
    Field("i_chrg_max", 20, "h", (), "A", 0.01, 0, _I16, 1200, "charging", "highest current while charging, requested from the charger"),
    Field("c_avg", 22, "h", (), "Ah", 0.01, 10, _I16, 2500, "cell", "capacity of a new cell"),
    Field("r_fs_avg", 24, "h", (), "ohm", 1e-5, 0, _I16, 210, "cell", "fast resistance of a new cell"),
    Field("r_fc_avg", 26, "h", (), "ohm", 1e-5, 0, _I16, 0, "cell", "slow resistance of a new cell"),
    Field("fc_avg", 28, "h", (), "", 1, 0, 1000, 10, "current sensor", "samples in the current average"),
    Field("fan_ramp_start", 30, "b", (), "degC", 1, -40, 100, 20, "fans", "hottest cell at which the fans leave their lowest duty", is_live=True),
    Field("fan_ramp_stop", 31, "b", (), "degC", 1, -40, 100, 50, "fans", "hottest cell at which the fans reach their highest duty", is_live=True),
    Field("fan_ramp_min", 32, "B", (), "duty", 1 / 255, 0, 255, 32, "fans", "lowest duty", is_live=True),
    Field("fan_ramp_max", 33, "B", (), "duty", 1 / 255, 0, 255, 224, "fans", "highest duty", is_live=True),
    Field("balance_threshold", 34, "H", (), "V", 1e-4, 10, 5000, 250, "charging", "a cell this far above the lowest is balanced", is_live=True),
    Field("v_alpha", 36, "H", (), "", 1e-3, 1, 1000, 500, "sampling", "weight of the new sample in the voltage filter"),
    Field("can_brp", 38, "B", (), "", 1, 3, 255, 7, "can", "CAN prescaler: bit rate = 32 MHz / ((can_brp + 1) 8)"),
    Field("can_tx_msg_en_startup", 39, "B", (), "mask", 1, 0, 255, 2, "can", "messages sent from start-up on, one bit each"),
    Field("can_tx_msg_id", 40, "I", (8,), "", 1, 0, 0xFFFFFFFF, _TX_IDS, "can", "CAN id; bit 31 marks a 29-bit id"),
    Field("can_tx_msg_timing", 72, "H", (8,), "ms", 1, 0, 60000, (1000, 100, 100, 0, 0, 0, 0, 0), "can", "time between two messages; 0 sends on demand only"),
    Field("can_tx_msg_len", 88, "B", (8,), "byte", 1, 0, 8, (8, 8, 8, 0, 0, 0, 0, 0), "can", "data bytes in the message"),
    Field("can_tx_msg_data", 96, "H", (8, 8), "", 1, 0, _U16, _TX_DATA, "can", "offset in this struct of each byte sent; 65535 sends 0"),
    Field("can_rx_msg_en_startup", 224, "B", (), "mask", 1, 0, 255, 1, "can", "messages received from start-up on, one bit each"),
    Field("telemetry_period", 226, "H", (), "ms", 1, 20, 10000, 100, "sampling", "time between two telemetry frames", is_live=True),
    Field("can_rx_msg_id", 228, "I", (8,), "", 1, 0, 0xFFFFFFFF, _RX_IDS, "can", "CAN id; bit 31 marks a 29-bit id"),
    Field("can_rx_msg_timeout", 260, "H", (8,), "ms", 1, 0, 60000, (5000, 0, 0, 0, 0, 0, 0, 0), "can", "time without the message after which it counts as lost; 0 never"),
    Field("can_rx_msg_len", 276, "B", (8,), "byte", 1, 0, 8, (8, 0, 0, 0, 0, 0, 0, 0), "can", "data bytes in the message"),
    Field("can_rx_msg_response", 284, "B", (8,), "", 1, 0, 255, (0,) + (NO_RESPONSE,) * 7, "can", "tx message activated by this one, plus 64 if it starts and stops charging; 255 none"),
    Field("can_rx_msg_data", 292, "H", (8, 8), "", 1, 0, _U16, _RX_DATA, "can", "offset in this struct of each byte received; 65535 ignores it"),
)
CONFIG_SIZE = 420

STATUS_FLAGS = ("fit", "usb", "i2c1", "usart1", "can1", "charger", "charging", "balancing", "load")
STATUS_FIELDS = (
    Field("flags", 0, "I", meaning="bits from 0: " + ", ".join(STATUS_FLAGS)),
    Field("can_tx_msg_en", 4, "B", unit="mask", meaning="tx messages being sent"),
    Field("can_rx_msg_en", 5, "B", unit="mask", meaning="rx messages enabled"),
    Field("can_rx_msg_active", 6, "B", unit="mask", meaning="rx messages received within their timeout"),
    Field("charger_status", 7, "B", meaning="the charger's last flags; 255 without a charger"),
)
STATUS_SIZE = 8

CHARGER_STATES = ("off", "waiting", "constant_current", "balancing", "constant_voltage", "done", "fault")
CHARGER_FIELDS = (  # content ours: the thesis prints only its size
    Field("v_set", 0, "H", unit="V", scale=0.1, meaning="voltage requested from the charger"),
    Field("i_set", 2, "H", unit="A", scale=0.1, meaning="current requested from the charger"),
    Field("v_out", 4, "H", unit="V", scale=0.1, meaning="output voltage reported by the charger"),
    Field("i_out", 6, "H", unit="A", scale=0.1, meaning="output current reported by the charger"),
    Field("control", 8, "B", meaning="0 charge, 1 stop"),
    Field("flags", 9, "B", meaning="bits from 0: hardware, over-temperature, input voltage, battery, time-out"),
    Field("state", 10, "B", meaning="the master's charging state: " + ", ".join(f"{i} {s}" for i, s in enumerate(CHARGER_STATES))),
    Field("fan_duty", 11, "B", unit="duty", scale=1 / 255, meaning="active fan duty"),
)
CHARGER_SIZE = 12

SLAVE_FIELDS = (
    Field("status", 0, "B", meaning="0 absent, 1 active, 255 fault"),
    Field("time", 4, "I", (18,), "us", meaning="time of each step of the last reading"),
    Field("cfgr", 76, "B", (6,), meaning="configuration register group, as read back"),
    Field("cvr", 82, "H", (12,), "V", 1e-4, meaning="cell voltages as read from the chip; 65535 no measurement"),
    Field("avr", 106, "H", (3,), "V", 1e-4, meaning="auxiliary voltages, GPIO 1 to 3"),
    Field("str", 112, "H", (6,), meaning="status register groups A and B"),
    Field("com", 124, "H", (3,), meaning="packets with a wrong PEC15 since the boot (stays at 65535) and in the last second, failed self-tests as bits: 0 cells, 1 auxiliary, 2 status, 3 multiplexer, 4 reference"),
    Field("temp", 130, "H", (24,), "V", 1e-4, meaning="voltages with the sensors switched in, two phases of 12"),
)
SLAVE_SIZE = 180

TOP_FIELDS = (
    Field("n_slaves", 440, "B", meaning="slaves that responded"),
    Field("i_fs", 1884, "i", unit="A", scale=0.01, meaning="current, positive on discharge, mean of the last ts samples"),
    Field("i_fc", 1888, "i", unit="A", scale=0.01, meaning="current, mean of the newest fc_avg samples, in whole means of ts"),
    Field("i_fc_hp", 1892, "i", unit="A", scale=0.01, meaning="averaged current in the master's high-precision path"),
    Field("v", 1896, "H", (96,), "V", 1e-4, meaning="cell voltages, filtered; 0 no measurement"),
    Field("ocv", 2088, "H", (96,), "V", 1e-4, meaning="open-circuit voltages"),
    Field("v_min", 2280, "H", unit="V", scale=1e-4, meaning="lowest cell voltage"),
    Field("v_max", 2282, "H", unit="V", scale=1e-4, meaning="highest cell voltage"),
    Field("v_avg", 2284, "H", unit="V", scale=1e-4, meaning="mean cell voltage"),
    Field("v_min_id", 2286, "B", meaning="cell index of v_min"),
    Field("v_max_id", 2287, "B", meaning="cell index of v_max"),
    Field("v_tot", 2288, "H", unit="V", scale=0.01, meaning="sum of the cells"),
    Field("t", 2290, "b", (96,), "degC", meaning="cell temperatures; -128 no measurement"),
    Field("t_min", 2386, "b", unit="degC", meaning="coldest cell"),
    Field("t_max", 2387, "b", unit="degC", meaning="hottest cell"),
    Field("t_avg", 2388, "b", unit="degC", meaning="mean cell temperature"),
    Field("t_min_id", 2389, "B", meaning="cell index of t_min"),
    Field("t_max_id", 2390, "B", meaning="cell index of t_max"),
    Field("dod", 2392, "I", unit="Ah", scale=1e-6, meaning="charge drawn since full, in uAh"),
    Field("c", 2396, "H", (96,), "Ah", 0.01, meaning="cell capacities"),
    Field("c_min", 2588, "H", unit="Ah", scale=0.01, meaning="lowest capacity"),
    Field("c_max", 2590, "H", unit="Ah", scale=0.01, meaning="highest capacity"),
    Field("c_avg", 2592, "H", unit="Ah", scale=0.01, meaning="mean capacity"),
    Field("c_min_id", 2594, "H", meaning="cell index of c_min"),
    Field("c_max_id", 2596, "H", meaning="cell index of c_max"),
    Field("r_fs", 2598, "H", (96,), "ohm", 1e-5, meaning="fast resistances"),
    Field("r_fc", 2790, "H", (96,), "ohm", 1e-5, meaning="slow resistances"),
    Field("soc", 2982, "H", unit="1", scale=1e-4, meaning="state of charge, the master's own count"),
)

# fmt: on

CHARGER_FLAGS = ("hardware", "over_temperature", "input_voltage", "battery", "timeout")
FLAGS: dict[str, tuple[str, ...]] = {"status.flags": STATUS_FLAGS, "charger.flags": CHARGER_FLAGS}  # from bit 0
VALUES: dict[str, dict[int, str]] = {  # what single values of a field stand for; in slaves for each of them
    "charger.control": {0: "charge", 1: "stop"},
    "charger.state": dict(enumerate(CHARGER_STATES)),
    "slave.status": {0: "absent", 1: "active", 255: "fault"},
}

MASTER_SIZE = 2984
CONFIG_OFFSET = 0
STATUS_OFFSET = 420
CHARGER_OFFSET = 428
SLAVE_OFFSET = 444
V_MISSING = 0
T_MISSING = -128
CHIP_MISSING = 0xFFFF  # LTC6804 register after power-up or clear


def all_fields() -> Iterator[Field]:
    """Every field of the master struct with its full name and its offset in it, in order of offset."""
    for field in CONFIG_FIELDS:
        yield replace(field, name=f"conf.{field.name}")
    for field in STATUS_FIELDS:
        yield replace(field, name=f"status.{field.name}", offset=STATUS_OFFSET + field.offset)
    for field in CHARGER_FIELDS:
        yield replace(field, name=f"charger.{field.name}", offset=CHARGER_OFFSET + field.offset)
    yield TOP_FIELDS[0]
    for slave in range(N_PACKS):
        for field in SLAVE_FIELDS:
            yield replace(
                field, name=f"slave[{slave}].{field.name}", offset=SLAVE_OFFSET + slave * SLAVE_SIZE + field.offset
            )
    yield from TOP_FIELDS[1:]


FIELDS: dict[str, Field] = {field.name: field for field in all_fields()}
_IN_ORDER = tuple(FIELDS.values())
CONFIG: dict[str, Field] = {field.name: field for field in CONFIG_FIELDS}

MAP_TEXT = "".join(f"{f.name} {f.offset} {f.fmt} {f.count} {f.scale:.9g}\n" for f in FIELDS.values())
MAP_HASH: bytes = hashlib.sha256(MAP_TEXT.encode()).digest()[:8]


def locate(offset: int) -> tuple[Field, int, int] | None:
    """Return (field, element, byte in the element) that the byte at `offset` belongs to, None for padding."""
    index = bisect.bisect_right(_IN_ORDER, offset, key=lambda field: field.offset) - 1
    field = _IN_ORDER[index]
    if index < 0 or offset >= field.end:
        return None
    element, byte = divmod(offset - field.offset, field.item_size)
    return field, element, byte


def element_name(field: Field, element: int) -> str:
    """Return the name of one element, with its index in brackets for each dimension: `can_tx_msg_data[1][3]`."""
    if not field.shape:
        return field.name
    indices: list[str] = []
    for length in reversed(field.shape):
        element, index = divmod(element, length)
        indices.insert(0, f"[{index}]")
    return field.name + "".join(indices)
