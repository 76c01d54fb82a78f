"""Every field of a profile: kind, default, unit and meaning. Parser and reference page are made from this table."""

from dataclasses import dataclass
from typing import Literal

from app.battery.serial import LONGEST_FRAME, SIGNALS, TYPES
from app.battery.source import CURRENT_UNITS, RESISTANCE_UNITS, SOC_UNITS, TEMPERATURE_UNITS, VOLTAGE_UNITS
from app.estimation.cell_model.default_cell import DEFAULT_CELL

KindOfField = Literal[
    "text",
    "texts",
    "number",
    "count",
    "counts",
    "flag",
    "numbers",
    "pair",
    "signal",
    "limit",
    "parts",
    "bases",
    "map",
    "bytes",
    "table",
]


@dataclass(frozen=True, slots=True)
class Field:
    """One key of a table."""

    name: str
    kind: KindOfField
    meaning: str
    default: str = "–"  # as the reference page shows it; "" = the field must be there
    unit: str = ""
    low: float = float("-inf")
    high: float = float("inf")
    one_of: tuple[str, ...] = ()


MOST_CELLS = 1000
_AGE = Field(
    "max_age_s", "number", "older values count as missing", "three times the measured interval", "s", 0.001, 3600
)
_ZERO = Field("zero", "number", "zero offset to subtract, in A, V or as a fraction", "0")
_LIMIT_FIELDS = (
    Field("cell_voltage_min_v", "limit", "lowest cell voltage", unit="V", low=0, high=10),
    Field("cell_voltage_max_v", "limit", "highest cell voltage", unit="V", low=0, high=10),
    Field("temperature_min_degc", "limit", "lowest cell temperature", unit="degC", low=-60, high=150),
    Field("temperature_max_degc", "limit", "highest cell temperature", unit="degC", low=-60, high=150),
    Field("discharge_current_max_a", "limit", "highest discharge current", unit="A", low=0, high=5000),
    Field("charge_current_max_a", "limit", "highest charge current", unit="A", low=0, high=5000),
    Field("pack_voltage_max_v", "limit", "highest pack voltage", unit="V", low=0, high=2000),
    Field("segment_voltage_max_v", "limit", "highest voltage of a pack", unit="V", low=0, high=2000),
)


def _cell_fields(units: tuple[str, ...], unit: str) -> tuple[Field, ...]:
    return (
        Field("signal", "text", "pattern of signal names: `{pack}`, `{group}`, `{cell}` for a number, `{pack:a}` for a letter, `*` for anything", ""),  # noqa: E501
        Field("message", "text", "pattern of message names", "`*`: any"),
        Field("numbers", "parts", "signals of the same frame with `pack`, `group` or `cell`; may contain `{cell}`", "none"),  # noqa: E501
        Field("base", "bases", "the lowest number, for all or by `pack`, `group`, `cell`", "0", low=0, high=65535),
        Field("group_cells", "count", "cells per group number; 1 if the group number is that of its first cell", "1", "cells", 1, MOST_CELLS),  # noqa: E501
        Field("first", "count", "cell of the lowest number, from 1", "1", low=1, high=MOST_CELLS),
        Field("order", "counts", "cell of the k-th number, from 1", "in order", low=1, high=MOST_CELLS),
        Field("unit", "text", "unit after the DBC's scale", "the DBC's", one_of=units),
        Field("scale", "number", "additional factor", "1"),
        Field("offset", "number", "added after unit and scale", "0", unit),
        Field("invalid", "counts", "raw values of a missing measurement", "none", low=-(2**63), high=2**64),
        Field("invalid_signal", "text", "pattern of a signal that is not 0 if invalid", "none"),
        Field("valid_signal", "text", "pattern of a signal that is 0 if invalid", "none"),
        Field("valid_range", "pair", "lowest and highest valid value", "any", unit),
        Field("checksum", "text", "frames with a wrong checksum are dropped; `orion`: last byte = id + length + sum of the other bytes, modulo 256", "none", one_of=("orion",)),  # noqa: E501
        _AGE,
    )  # fmt: skip


def _reading(units: tuple[str, ...], *more: Field) -> tuple[Field, ...]:
    signal = Field("signal", "signal", "`MESSAGE.SIGNAL`, or `SIGNAL` if unique", "")
    unit = Field("unit", "text", "unit after the DBC's scale", "the DBC's", one_of=units)
    return (signal, unit, *more, _ZERO, _AGE)


_STATE = (
    Field("signal", "signal", "`MESSAGE.SIGNAL`, or `SIGNAL` if unique", ""),
    Field("equals", "counts", "raw values that mean yes", "[1]", low=-(2**63), high=2**64),
    Field("mask", "count", "instead of `equals`: any of these bits means yes", "0", low=0, high=2**64),
)
_POSITIVE = Field("positive", "text", "meaning of a positive value", "`discharge`", one_of=("discharge", "charge"))

_ORDER = Field("byte_order", "text", "order of the bytes of a number", "that of `[serial]`", one_of=("little", "big"))
_AT = Field(
    "at", "count", "byte of the first value; negative counts from the end", "0", "bytes", -LONGEST_FRAME, LONGEST_FRAME
)
_POLLS = Field("poll_s", "number", "interval of `poll`", "1", "s", 0.05, 3600)
_OF_VALUES = (
    Field("name", "text", "name of the field", "name of the signal"),
    Field("signal", "text", "quantity", "", one_of=tuple(SIGNALS)),
    Field("first", "count", "cell or sensor of the first value, from 1", "1", low=1, high=MOST_CELLS),
    Field("scale", "number", "value = raw * scale + offset, in V, A, degC, ohm; SOC as a fraction of 1", "1"),
    Field("offset", "number", "added after `scale`", "0"),
    _POSITIVE,
    Field("invalid", "counts", "raw values of a missing measurement", "none", low=-(2**63), high=2**64),
    Field("valid_range", "pair", "lowest and highest valid value", "any"),
    Field("equals", "counts", "raw values of a state that mean yes", "[1]", low=-(2**63), high=2**64),
    Field("mask", "count", "instead of `equals`: any of these bits means yes", "0", low=0, high=2**64),
    _AGE,
)  # fmt: skip
_CHECKSUM = (
    Field("kind", "text", "`none`, `sum8`, `xor8`, `sum16`, `sum16-complement`, or a name of crccheck: `crc-16/modbus`", ""),  # noqa: E501
    Field("from", "count", "first byte that it covers", "0", "bytes", -LONGEST_FRAME, LONGEST_FRAME),
    Field("to", "count", "byte after the last one that it covers; negative counts from the end", "`at`", "bytes", -LONGEST_FRAME, LONGEST_FRAME),  # noqa: E501
    Field("at", "count", "first byte of the checksum; negative counts from the end", "-1", "bytes", -LONGEST_FRAME, LONGEST_FRAME),  # noqa: E501
    _ORDER,
)  # fmt: skip
_SERIAL_TABLES: dict[str, tuple[Field, ...]] = {
    "serial": (
        Field("baud", "count", "speed of the line", "115200", "bit/s", 50, 12_000_000),
        Field("parity", "text", "parity bit", "`none`", one_of=("none", "even", "odd")),
        Field("data_bits", "count", "bits of a character", "8", low=5, high=8),
        Field("stop_bits", "number", "stop bits", "1", low=1, high=2),
        Field("start", "bytes", "sent when the port opens and while the line is silent; text, or `{hex = \"DD A5\"}`", "nothing"),  # noqa: E501
        Field("stop", "bytes", "sent before the port closes; text, or `{hex = \"DD A5\"}`", "nothing"),
        Field("byte_order", "text", "order of the bytes of a number", "`little`", one_of=("little", "big")),
        Field("period_s", "number", "interval between measurements", "0.1", "s", 0.001, 60),
    ),
    "serial.frame": (
        Field("name", "text", "name of the frame", "its position"),
        Field("header", "text", "fixed first bytes, hex; `??` is any byte", "none: `gap_s` and `length`"),
        Field("length", "count", "length of the whole frame", "`length_at`", "bytes", 1, LONGEST_FRAME),
        Field("gap_s", "number", "silence before and after a frame without a header", "none", "s", 0.001, 60),
        Field("end", "text", "fixed last bytes, hex", "none"),
        Field("poll", "text", "request for the frame, hex, sent every `poll_s`", "none"),
        _POLLS,
    ),
    "serial.frame.length_at": (
        Field("offset", "count", "byte of the number", "", "bytes", 0, LONGEST_FRAME),
        Field("size", "count", "number of bytes", "1", "bytes", 1, 4),
        Field("adds", "count", "length of the frame = number + `adds`", "0", "bytes", -LONGEST_FRAME, LONGEST_FRAME),
        _ORDER,
    ),
    "serial.frame.checksum": _CHECKSUM,
    "serial.line.checksum": _CHECKSUM,
    "serial.frame.fields": (
        *_OF_VALUES,
        Field("type", "text", "type of each value; `sm16`: sign and magnitude, the highest bit is the sign", "", one_of=tuple(TYPES)),  # noqa: E501
        _AT,
        Field("count", "count", "number of values", "1", low=1, high=MOST_CELLS),
        Field("stride", "count", "bytes from one value to the next", "no gap", "bytes", 0, LONGEST_FRAME),
        Field("bits", "flag", "each value is a mask, lowest bit first, with `count` bits in total", "false"),
        _ORDER,
    ),
    "serial.frame.fields.index": (
        Field("at", "count", "byte with the number of the frame within a sample", "", "bytes", -LONGEST_FRAME, LONGEST_FRAME),  # noqa: E501
        Field("type", "text", "type of the number", "`u8`", one_of=tuple(TYPES)),
        Field("base", "count", "lowest number", "0", low=0, high=65535),
        _ORDER,
    ),
    "serial.frame.fields.charging": (
        Field("at", "count", "byte of the number", "", "bytes", -LONGEST_FRAME, LONGEST_FRAME),
        Field("type", "text", "type of the number", "`u8`", one_of=tuple(TYPES)),
        Field("equals", "counts", "numbers that mean charging", "[1]", low=-(2**63), high=2**64),
        Field("mask", "count", "instead of `equals`: any of these bits means charging", "0", low=0, high=2**64),
        _ORDER,
    ),
    "serial.line": (
        Field("name", "text", "name of the line", "its position"),
        Field("separator", "text", "separator of the columns; a space matches any number of spaces", "`,`"),
        Field("pattern", "text", "expression with named groups (RE2), instead of columns", "none"),
        Field("begin", "text", "text before the first column", "none"),
        Field("end", "text", "text after the last column", "the line's end"),
        Field("hex", "flag", "bytes in hex without a separator: `fields` as in a frame, bytes counted after `begin`", "false"),  # noqa: E501
        Field("poll", "bytes", "request for the line, sent every `poll_s`; text, or `{hex = \"DD A5\"}`", "none"),
        _POLLS,
    ),
    "serial.line.fields": (
        *_OF_VALUES,
        Field("column", "count", "column, from 0", "`columns`, `group`", low=0, high=LONGEST_FRAME),
        Field("columns", "counts", "first and last column, from 0", "`column`, `group`", low=0, high=LONGEST_FRAME),
        Field("group", "text", "group of `pattern`", "none"),
        Field("begin", "text", "text before the number, such as `C1=3.70`", "none"),
        Field("end", "text", "text after the number, such as `3.70V`", "none"),
        Field("base", "count", "10, or 16 for hex", "10", low=10, high=16),
        Field("signed", "flag", "in hex, a two's complement number of all its digits", "false"),
    ),
    "serial.line.fields.index": (
        Field("column", "count", "column with the number of the line within a sample, taken from its last digits", "`group`", low=0, high=LONGEST_FRAME),  # noqa: E501
        Field("group", "text", "group of `pattern`", "none"),
        Field("base", "count", "lowest number", "0", low=0, high=65535),
    ),
}  # fmt: skip

TABLES: dict[str, tuple[Field, ...]] = {
    "": (Field("include", "texts", "profiles to inherit from: bundled names, or files in the same folder", "none"),),
    "battery": (
        Field("name", "text", "name of the battery", ""),
        Field("packs", "counts", "cells of each pack in order; older profiles: `segments`", "", "cells", 1, MOST_CELLS),
        Field("parallel", "count", "cells in parallel per measured cell", "1", "cells", 1, 1000),
        Field("cell", "text", "cell file or bundled cell, of one measured cell", f"`{DEFAULT_CELL}`"),
        Field("bleed_ohm", "number", "balancing resistor of a measured cell; without it the season data has no balancing charge", "unknown", "ohm", 0.01, 10_000),  # noqa: E501
    ),
    "battery.drawing": (
        Field("rows", "count", "rows of packs on the map", "1", low=1, high=100),
        Field("order", "counts", "packs from left to right, row by row, from 1", "as counted", low=1, high=MOST_CELLS),
        Field("turned", "counts", "packs that count from right to left, from 1", "none", low=1, high=MOST_CELLS),
    ),
    "battery.temperatures": (
        Field("sensors", "count", "number of temperature sensors", "one per cell", low=0, high=5000),
        Field("cells", "map", "cells of each sensor: `each`, `pack` (evenly within packs), `spread` (evenly over all), or a list of lists of cells, from 1", "`each`, else `spread`"),  # noqa: E501
    ),
    "battery.limits": _LIMIT_FIELDS,
    "battery.rules": tuple(Field(f.name, "number", f.meaning + ", by the rules", unit=f.unit, low=f.low, high=f.high) for f in _LIMIT_FIELDS),  # noqa: E501
    "source": (
        Field("kind", "text", "`dbc` for CAN, `master` for the built-in master, `table` for an imported table", "`dbc`", one_of=("dbc", "master", "table")),  # noqa: E501
        Field("dbc", "texts", "message definitions (DBC, SYM, KCD, ARXML), relative to the profile", ""),
        Field("period_s", "number", "interval between measurements", "0.1", "s", 0.001, 60),
        Field("means_s", "number", "`table`: time over which each current is a mean; 0: instants", "0", "s", 0, 3600),
        Field("bit_rate", "count", "bit rate of the bus, to calculate the bus load", "from `?bitrate=`", "bit/s", 5_000, 8_000_000),  # noqa: E501
    ),
    "source.voltage": _cell_fields(tuple(VOLTAGE_UNITS), "V"),
    "source.temperature": _cell_fields(tuple(TEMPERATURE_UNITS), "degC"),
    "source.balancing": _cell_fields((), ""),
    "source.resistance": _cell_fields(tuple(RESISTANCE_UNITS), "ohm"),
    "source.current": _reading(tuple(CURRENT_UNITS), _POSITIVE),
    "source.pack_voltage": _reading(tuple(VOLTAGE_UNITS)),
    "source.soc": _reading(tuple(SOC_UNITS)),
    "source.charger_voltage": _reading(tuple(VOLTAGE_UNITS)),
    "source.charger_current": _reading(tuple(CURRENT_UNITS), _POSITIVE),
    **{f"source.state.{name}": _STATE for name in ("closed", "precharge", "fault", "charging", "balancing")},
    **_SERIAL_TABLES,
}  # fmt: skip
MANY = (
    "source.voltage", "source.temperature", "source.balancing", "source.resistance", "serial.frame", "serial.line",
)  # fmt: skip  # written [[source.voltage]]
