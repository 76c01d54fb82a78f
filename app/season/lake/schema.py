"""The tables of the season lake: every column's type, unit and meaning. Version 3.

The documentation (`docs/reference/season-lake.md`) and the metadata of the Parquet files are made from these tables.
Types are those of `TYPES`; a column that is not measured or not known is null, never 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

from app.errors import ExtraMissing
from app.words import Message

LAKE_VERSION: Final = 5  # a lake of an older number is made again from its sessions
WHOLE: Final = 0  # number of the row that stands for a whole session, in the column `lap`
SAMPLES: Final = "samples"
MARK: Final = "sessions"  # the table that is written last: with it a session is in the lake
TYPES: Final = {
    "text": "UTF-8 string",
    "number": "float64",
    "count": "int32",
    "time": "timestamp, microseconds, UTC",
    "flag": "boolean",
}


class Column(NamedTuple):
    """One column of a table of facts."""

    name: str
    type: str
    unit: str
    meaning: str


WHERE: Final = (
    Column("car", "text", "", "whose session it is, as in the folder's name"),
    Column("season", "text", "", "year of its start (UTC), or what the session's metadata say"),
    Column("session", "text", "", "its id: the name of its file"),
)
_START = Column("start_time", "time", "", "begin of the session, or of the lap")
_ENERGIES = (
    Column("energy_out_wh", "number", "Wh", "energy discharged; missing where a cell was, under load"),
    Column("energy_in_wh", "number", "Wh", "energy charged, braking included; positive; missing likewise"),
)
_CHARGES = (
    Column("charge_out_ah", "number", "Ah", "charge discharged"),
    Column("charge_in_ah", "number", "Ah", "charge charged; positive"),
)

SESSIONS: Final = (
    *WHERE,
    Column("name", "text", "", "what people call it"),
    _START,
    Column("end_time", "time", "", "its last sample"),
    Column("duration_s", "number", "s", "from start to end"),
    Column("driving_s", "number", "s", "with a current beyond 2 A"),
    Column("simulated", "flag", "", "of the simulated car"),
    Column("battery", "text", "", "name of the battery's profile"),
    Column("n_cells", "count", "", "number of cells"),
    Column("segments", "text", "", "cells of each pack, as a JSON list"),
    Column("n_laps", "count", "", "number of whole laps"),
    Column("laps_from", "text", "", "`settled`, `markers` or `pattern`: where the laps come from"),
    *_ENERGIES,
    *_CHARGES,
    Column("current_max_a", "number", "A", "highest current, positive on discharge"),
    Column("power_max_w", "number", "W", "highest power"),
    Column("cell_file", "text", "", "name of the cell model that judged it"),
    Column("cell_file_of_then", "flag", "", "whether the session itself keeps that cell model"),
    Column("recorded_by", "text", "", "version of Voltwall that recorded it"),
    Column("metadata", "text", "", "the session's metadata and tags, as a JSON object"),
    Column("layout", "text", "", "the same where two sessions have the same columns in `samples`"),
    Column("built_by", "text", "", "version of Voltwall that made these rows"),
    Column("source_file", "text", "", "path of the session's file when it was read"),
    Column("source_state", "text", "", "its time of change and size: what has changed since is read again"),
)
LAPS: Final = (
    *WHERE,
    Column("lap", "count", "", "from 1"),
    _START,
    Column("duration_s", "number", "s", "time of the lap"),
    Column("driver", "text", "", "who drove; empty where nobody said"),
    Column("note", "text", "", "what somebody wrote of it"),
    Column("counts", "flag", "", "false: an out-lap, an incident, a partial lap; not compared"),
    *_ENERGIES,
    Column("power_mean_w", "number", "W", "mean power"),
    Column("power_max_w", "number", "W", "highest power"),
    Column("power_min_w", "number", "W", "strongest regeneration, negative"),
    Column("current_rms_a", "number", "A", "root mean square of the current"),
    Column("soc_used", "number", "1", "mean SOC at its begin, less at its end"),
    Column("temperature_rise_k", "number", "K", "of the mean of all cells"),
    Column("temperature_max_degc", "number", "degC", "of the hottest cell"),
    Column("temperature_max_cell", "count", "", "whose it is"),
    Column("voltage_min_v", "number", "V", "of the weakest cell"),
    Column("weakest_cell", "count", "", "whose it is"),
)
CELLS: Final = (
    *WHERE,
    Column("lap", "count", "", f"from 1; {WHOLE}: the whole session, what lies between laps included"),
    Column("cell", "count", "", "index from 0 through the packs in order"),
    Column("pack", "count", "", "from 1, as people see it"),
    Column("cell_in_pack", "count", "", "from 1, as people see it"),
    _START,
    Column("duration_s", "number", "s", "of the session or the lap"),
    Column("voltage_min_v", "number", "V", "lowest voltage"),
    Column("voltage_max_v", "number", "V", "highest voltage"),
    *_ENERGIES,
    *_CHARGES,
    Column("resistance_ohm", "number", "ohm", "slope of voltage over current, with the cell's joint"),
    Column("resistance_sigma_ohm", "number", "ohm", "its standard deviation"),
    Column(
        "resistance_factor",
        "number",
        "1",
        "resistance over that of the cell model at the temperature and SOC of each moment; in rows of whole sessions",
    ),
    Column("resistance_factor_sigma", "number", "1", "its standard deviation"),
    Column("sag_v", "number", "V", "mean, below the mean of all cells, above 50 A"),
    Column("temperature_first_degc", "number", "degC", "first temperature"),
    Column("temperature_mean_degc", "number", "degC", "mean over time"),
    Column("temperature_max_degc", "number", "degC", "highest temperature"),
    Column("soc_first", "number", "1", "first estimate of the SOC"),
    Column("soc_last", "number", "1", "last estimate of the SOC"),
    Column("soc_mean", "number", "1", "mean over time"),
    Column("soc_used", "number", "1", "first less last"),
    Column("lowest_s", "number", "s", "while driving, as the lowest cell of all"),
    Column("near_v_min_s", "number", "s", "within 0.2 V of the lowest voltage allowed then, or beyond it"),
    Column("near_v_max_s", "number", "s", "within 0.02 V of the highest voltage allowed then, or beyond it"),
    Column("near_t_max_s", "number", "s", "within 5 K of the highest temperature allowed then, or beyond it"),
    Column("balancing_s", "number", "s", "bled"),
    Column("bled_v_s", "number", "V s", "integral of the voltage while bled; over the resistor it is the charge bled"),
    Column("bled_ah", "number", "Ah", "charge bled, where the battery's profile states `bleed_ohm`"),
    Column("missing", "count", "", "samples without a voltage"),
    Column("first_rest_time", "time", "", "end of the first rest of the session; in rows of whole sessions, as below"),
    Column("first_rest_v", "number", "V", "voltage then"),
    Column("first_rest_soc", "number", "1", "SOC then, by the voltage and the cell model"),
    Column("last_rest_time", "time", "", "end of the last rest"),
    Column("last_rest_v", "number", "V", "voltage then"),
    Column("last_rest_soc", "number", "1", "SOC then, by the voltage and the cell model"),
    Column("counted_soc", "number", "1", "change of the SOC between the two rests that lie farthest apart in SOC"),
    Column("counted_soc_sigma", "number", "1", "its standard deviation"),
    Column("counted_ah", "number", "Ah", "charge counted between them"),
    Column("counted_ah_sigma", "number", "Ah", "its standard deviation"),
    Column("capacity_ah", "number", "Ah", "capacity, where this session alone tells it: counted_ah / counted_soc"),
    Column("capacity_sigma_ah", "number", "Ah", "its standard deviation"),
    Column("findings", "text", "", "codes of what was found of the cell, with spaces between; empty: nothing"),
)
EVENTS: Final = (
    *WHERE,
    Column("time", "time", "", "when, by the session's clock"),
    Column("lap", "count", "", "lap in which it was; null between laps"),
    Column("code", "text", "", "what: see the list of alarms"),
    Column("severity", "text", "", "`info`, `warning`, `trip` and the like"),
    Column("text", "text", "", "in English"),
    Column("cell", "count", "", "index from 0, null where it is not of one cell"),
    Column("value", "number", "", "in `unit`"),
    Column("limit_value", "number", "", "in `unit`"),
    Column("unit", "text", "", "of both"),
)
TABLES: Final = {"sessions": SESSIONS, "laps": LAPS, "cells": CELLS, "events": EVENTS}


def pyarrow_or_error() -> Any:
    """Return pyarrow.

    Raises:
        ExtraMissing: it is not installed.
    """
    try:
        import pyarrow
    except ImportError as error:
        raise ExtraMissing(Message("the-season-lake"), "pyarrow", "season") from error
    return pyarrow


def arrow_schema(columns: Sequence[Column], about: dict[str, str] | None = None) -> Any:
    """Return columns as an Arrow schema with unit and meaning of each."""
    pa = pyarrow_or_error()
    types = {
        "text": pa.string(),
        "number": pa.float64(),
        "count": pa.int32(),
        "time": pa.timestamp("us", "UTC"),
        "flag": pa.bool_(),
    }
    fields = [
        pa.field(each.name, types[each.type], metadata={"unit": each.unit, "meaning": each.meaning}) for each in columns
    ]
    return pa.schema(fields, metadata=about)


def name_of_table(name: str) -> str:
    """Return the file name of a table: one of `TABLES`, or `SAMPLES`."""
    if name not in TABLES and name != SAMPLES:
        raise KeyError(name)
    return f"{name}.parquet"
