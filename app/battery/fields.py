"""Every field of a profile: kind, default, unit and meaning. Parser and reference page are made from this table."""

from dataclasses import dataclass
from typing import Literal

from app.battery.source import CURRENT_UNITS, RESISTANCE_UNITS, SOC_UNITS, TEMPERATURE_UNITS, VOLTAGE_UNITS
from app.estimation.cell_model.default_cell import DEFAULT_CELL

KindOfField = Literal[
    "text", "texts", "number", "count", "counts", "flag", "numbers", "pair", "signal", "limit", "parts", "bases", "map"
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
    "max_age_s", "number", "a value that is older is missing", "measured: three periods as heard", "s", 0.001, 3600
)
_ZERO = Field("zero", "number", "what is subtracted, in A or V or as a fraction", "0")
_LIMIT_FIELDS = (
    Field("cell_voltage_min_v", "limit", "lowest cell voltage", unit="V", low=0, high=10),
    Field("cell_voltage_max_v", "limit", "highest cell voltage", unit="V", low=0, high=10),
    Field("temperature_min_degc", "limit", "lowest cell temperature", unit="degC", low=-60, high=150),
    Field("temperature_max_degc", "limit", "highest cell temperature", unit="degC", low=-60, high=150),
    Field("discharge_current_max_a", "limit", "highest discharge current", unit="A", low=0, high=5000),
    Field("charge_current_max_a", "limit", "highest charge current", unit="A", low=0, high=5000),
    Field("pack_voltage_max_v", "limit", "highest voltage of all cells together", unit="V", low=0, high=2000),
    Field("segment_voltage_max_v", "limit", "highest voltage of one segment", unit="V", low=0, high=2000),
)


def _cell_fields(units: tuple[str, ...], unit: str) -> tuple[Field, ...]:
    return (
        Field("signal", "text", "pattern of the signals: `{segment}`, `{group}`, `{cell}` stand for a number, `{segment:a}` for a letter, `*` for anything", ""),  # noqa: E501
        Field("message", "text", "pattern of the messages' names, with the same placeholders", "`*`: any"),
        Field("numbers", "parts", "signals of the same frame that tell `segment`, `group` or `cell`; may hold the signal's own `{cell}`", "none"),  # noqa: E501
        Field("base", "bases", "the lowest number: one for all, or a table by `segment`, `group`, `cell`", "0", low=0, high=65535),  # noqa: E501
        Field("group_cells", "count", "cells from one group number to the next; 1 where the group number is that of its first cell", "1", "cells", 1, MOST_CELLS),  # noqa: E501
        Field("first", "count", "the cell, from 1, of which the lowest numbers tell; for messages whose numbers begin anew", "1", low=1, high=MOST_CELLS),  # noqa: E501
        Field("order", "counts", "the k-th number is that of this cell, from 1; as many numbers as cells (sensors)", "in order", low=1, high=MOST_CELLS),  # noqa: E501
        Field("unit", "text", "unit of the signal after the DBC's own scale", "the DBC's", one_of=units),
        Field("scale", "number", "factor on top", "1"),
        Field("offset", "number", "added after unit and scale", "0", unit),
        Field("invalid", "counts", "raw numbers that mean: not measured", "none", low=-(2**63), high=2**64),
        Field("invalid_signal", "text", "pattern of a signal that is not 0 where the value is invalid", "none"),
        Field("valid_signal", "text", "pattern of a signal that is 0 where the value is invalid", "none"),
        Field("valid_range", "pair", "lowest and highest value; beyond them it is missing", "any", unit),
        Field("checksum", "text", "frames whose checksum is wrong are dropped; `orion`: last byte = id + length + sum of the bytes before, modulo 256", "none", one_of=("orion",)),  # noqa: E501
        _AGE,
    )  # fmt: skip


def _reading(units: tuple[str, ...], *more: Field) -> tuple[Field, ...]:
    signal = Field("signal", "signal", "`MESSAGE.SIGNAL`, or `SIGNAL` where one message only has it", "")
    unit = Field("unit", "text", "unit of the signal after the DBC's own scale", "the DBC's", one_of=units)
    return (signal, unit, *more, _ZERO, _AGE)


_STATE = (
    Field("signal", "signal", "`MESSAGE.SIGNAL`, or `SIGNAL` where one message only has it", ""),
    Field("equals", "counts", "raw numbers that mean yes", "[1]", low=-(2**63), high=2**64),
    Field("mask", "count", "bits of which one set means yes; `equals` is not used then", "0", low=0, high=2**64),
)
_POSITIVE = Field("positive", "text", "what a positive number means", "`discharge`", one_of=("discharge", "charge"))

TABLES: dict[str, tuple[Field, ...]] = {
    "": (Field("include", "texts", "profiles of which this one takes what it does not say itself: names of bundled ones, or files beside it", "none"),),  # noqa: E501
    "battery": (
        Field("name", "text", "what people call it", ""),
        Field("segments", "counts", "cells of each segment, in the order in which cells are counted; segments may differ", "", "cells", 1, MOST_CELLS),  # noqa: E501
        Field("parallel", "count", "cells in parallel that are measured as one", "1", "cells", 1, 1000),
        Field("cell", "text", "cell file, or name of a bundled cell: the model of what is measured as one", f"`{DEFAULT_CELL}`"),  # noqa: E501
        Field("bleed_ohm", "number", "resistor that what is measured as one is bled through while it is balanced; without it the season tells volt-seconds bled, and no charge", "not known", "ohm", 0.01, 10_000),  # noqa: E501
    ),
    "battery.drawing": (
        Field("rows", "count", "rows of segments on the map", "1", low=1, high=100),
        Field("order", "counts", "segments from left to right, row by row, from 1", "as counted", low=1, high=MOST_CELLS),  # noqa: E501
        Field("turned", "counts", "segments whose cells count from right to left, from 1", "none", low=1, high=MOST_CELLS),  # noqa: E501
    ),
    "battery.temperatures": (
        Field("sensors", "count", "number of temperature sensors; fewer or more than cells", "one a cell", low=0, high=5000),  # noqa: E501
        Field("cells", "map", "which cells each stands for: `each`, `segment` (as many in each segment, evenly over its cells), `spread` (evenly over all), or a list of lists of cells, from 1", "`each`, else `spread`"),  # noqa: E501
    ),
    "battery.limits": _LIMIT_FIELDS,
    "battery.rules": tuple(Field(f.name, "number", f.meaning + ", by the rules", unit=f.unit, low=f.low, high=f.high) for f in _LIMIT_FIELDS),  # noqa: E501
    "source": (
        Field("kind", "text", "`dbc`: CAN by a DBC; `master`: the team's own master; `table`: an imported table, in its session alone", "`dbc`", one_of=("dbc", "master", "table")),  # noqa: E501
        Field("dbc", "texts", "files of message definitions (DBC, SYM, KCD, ARXML), relative to the profile", ""),
        Field("period_s", "number", "between two measurements that are made of what was heard", "0.1", "s", 0.001, 60),
        Field("bit_rate", "count", "of the bus: what its load is a share of", "by the bus named with `?bitrate=`", "bit/s", 5_000, 8_000_000),  # noqa: E501
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
}  # fmt: skip
MANY = ("source.voltage", "source.temperature", "source.balancing", "source.resistance")  # written [[source.voltage]]
