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


class LakeColumn(NamedTuple):
    """One column of a table of facts."""

    name: str
    type: str
    unit: str
    meaning: str


WHERE: Final = (
    LakeColumn("car", "text", "", "whose session it is, as in the folder's name"),
    LakeColumn("season", "text", "", "year of its start (UTC), or what the session's metadata say"),
    LakeColumn("session", "text", "", "its id: the name of its file"),
)
_START = LakeColumn("start_time", "time", "", "begin of the session, or of the lap")
_ENERGIES = (
    LakeColumn("energy_out_wh", "number", "Wh", "energy discharged; missing where a cell was, under load"),
    LakeColumn("energy_in_wh", "number", "Wh", "energy charged, braking included; positive; missing likewise"),
)
_CHARGES = (
    LakeColumn("charge_out_ah", "number", "Ah", "charge discharged"),
    LakeColumn("charge_in_ah", "number", "Ah", "charge charged; positive"),
)

SESSIONS: Final = (
    *WHERE,
    LakeColumn("name", "text", "", "what people call it"),
    _START,
    LakeColumn("end_time", "time", "", "its last sample"),
    LakeColumn("duration_s", "number", "s", "from start to end"),
    LakeColumn("driving_s", "number", "s", "with a current beyond 2 A"),
    LakeColumn("simulated", "flag", "", "of the simulated car"),
    LakeColumn("battery", "text", "", "name of the battery's profile"),
    LakeColumn("n_cells", "count", "", "number of cells"),
    LakeColumn("segments", "text", "", "cells of each pack, as a JSON list"),
    LakeColumn("n_laps", "count", "", "number of whole laps"),
    LakeColumn("laps_from", "text", "", "`settled`, `markers` or `pattern`: where the laps come from"),
    *_ENERGIES,
    *_CHARGES,
    LakeColumn("current_max_a", "number", "A", "highest current, positive on discharge"),
    LakeColumn("power_max_w", "number", "W", "highest power"),
    LakeColumn("cell_file", "text", "", "name of the cell model that judged it"),
    LakeColumn("cell_file_of_then", "flag", "", "whether the session itself keeps that cell model"),
    LakeColumn("recorded_by", "text", "", "version of Voltwall that recorded it"),
    LakeColumn("metadata", "text", "", "the session's metadata and tags, as a JSON object"),
    LakeColumn("layout", "text", "", "the same where two sessions have the same columns in `samples`"),
    LakeColumn("built_by", "text", "", "version of Voltwall that made these rows"),
    LakeColumn("source_file", "text", "", "path of the session's file when it was read"),
    LakeColumn("source_state", "text", "", "its time of change and size: what has changed since is read again"),
)
LAPS: Final = (
    *WHERE,
    LakeColumn("lap", "count", "", "from 1"),
    _START,
    LakeColumn("duration_s", "number", "s", "time of the lap"),
    LakeColumn("driver", "text", "", "who drove; empty where unknown"),
    LakeColumn("note", "text", "", "what somebody wrote of it"),
    LakeColumn("counts", "flag", "", "false: an out-lap, an incident, a partial lap; not compared"),
    *_ENERGIES,
    LakeColumn("power_mean_w", "number", "W", "mean power"),
    LakeColumn("power_max_w", "number", "W", "highest power"),
    LakeColumn("power_min_w", "number", "W", "strongest regeneration, negative"),
    LakeColumn("current_rms_a", "number", "A", "root mean square of the current"),
    LakeColumn("soc_used", "number", "1", "mean SOC at its begin, less at its end"),
    LakeColumn("temperature_rise_k", "number", "K", "of the mean of all cells"),
    LakeColumn("temperature_max_degc", "number", "degC", "of the hottest cell"),
    LakeColumn("temperature_max_cell", "count", "", "whose it is"),
    LakeColumn("voltage_min_v", "number", "V", "of the weakest cell"),
    LakeColumn("weakest_cell", "count", "", "whose it is"),
)
CELLS: Final = (
    *WHERE,
    LakeColumn("lap", "count", "", f"from 1; {WHOLE}: the whole session, what lies between laps included"),
    LakeColumn("cell", "count", "", "index from 0 through the packs in order"),
    LakeColumn("pack", "count", "", "from 1, as people see it"),
    LakeColumn("cell_in_pack", "count", "", "from 1, as people see it"),
    _START,
    LakeColumn("duration_s", "number", "s", "of the session or the lap"),
    LakeColumn("voltage_min_v", "number", "V", "lowest voltage"),
    LakeColumn("voltage_max_v", "number", "V", "highest voltage"),
    *_ENERGIES,
    *_CHARGES,
    LakeColumn("resistance_ohm", "number", "ohm", "slope of voltage over current, with the cell's joint"),
    LakeColumn("resistance_sigma_ohm", "number", "ohm", "its standard deviation"),
    LakeColumn(
        "resistance_factor",
        "number",
        "1",
        "resistance over that of the cell model at the temperature and SOC of each moment; in rows of whole sessions",
    ),
    LakeColumn("resistance_factor_sigma", "number", "1", "its standard deviation"),
    LakeColumn("sag_v", "number", "V", "mean, below the mean of all cells, above 50 A"),
    LakeColumn("temperature_first_degc", "number", "degC", "first temperature"),
    LakeColumn("temperature_mean_degc", "number", "degC", "mean over time"),
    LakeColumn("temperature_max_degc", "number", "degC", "highest temperature"),
    LakeColumn("soc_first", "number", "1", "first estimate of the SOC"),
    LakeColumn("soc_last", "number", "1", "last estimate of the SOC"),
    LakeColumn("soc_mean", "number", "1", "mean over time"),
    LakeColumn("soc_used", "number", "1", "first less last"),
    LakeColumn("lowest_s", "number", "s", "while driving, as the lowest cell of all"),
    LakeColumn("near_v_min_s", "number", "s", "within 0.2 V of the lowest voltage allowed then, or beyond it"),
    LakeColumn("near_v_max_s", "number", "s", "within 0.02 V of the highest voltage allowed then, or beyond it"),
    LakeColumn("near_t_max_s", "number", "s", "within 5 K of the highest temperature allowed then, or beyond it"),
    LakeColumn("balancing_s", "number", "s", "bled"),
    LakeColumn(
        "bled_v_s", "number", "V s", "integral of the voltage while bled; over the resistor it is the charge bled"
    ),
    LakeColumn("bled_ah", "number", "Ah", "charge bled, where the battery's profile states `bleed_ohm`"),
    LakeColumn("missing", "count", "", "samples without a voltage"),
    LakeColumn(
        "first_rest_time", "time", "", "end of the first rest of the session; in rows of whole sessions, as below"
    ),
    LakeColumn("first_rest_v", "number", "V", "voltage then"),
    LakeColumn("first_rest_soc", "number", "1", "SOC then, by the voltage and the cell model"),
    LakeColumn("last_rest_time", "time", "", "end of the last rest"),
    LakeColumn("last_rest_v", "number", "V", "voltage then"),
    LakeColumn("last_rest_soc", "number", "1", "SOC then, by the voltage and the cell model"),
    LakeColumn("counted_soc", "number", "1", "change of the SOC between the two rests that lie farthest apart in SOC"),
    LakeColumn("counted_soc_sigma", "number", "1", "its standard deviation"),
    LakeColumn("counted_ah", "number", "Ah", "charge counted between them"),
    LakeColumn("counted_ah_sigma", "number", "Ah", "its standard deviation"),
    LakeColumn("capacity_ah", "number", "Ah", "capacity, where this session alone tells it: counted_ah / counted_soc"),
    LakeColumn("capacity_sigma_ah", "number", "Ah", "its standard deviation"),
    LakeColumn("findings", "text", "", "codes of what was found of the cell, with spaces between; empty: nothing"),
)
EVENTS: Final = (
    *WHERE,
    LakeColumn("time", "time", "", "when, by the session's clock"),
    LakeColumn("lap", "count", "", "lap in which it was; null between laps"),
    LakeColumn("code", "text", "", "what: see the list of alarms"),
    LakeColumn("severity", "text", "", "`info`, `warning`, `trip` and the like"),
    LakeColumn("text", "text", "", "in English"),
    LakeColumn("cell", "count", "", "index from 0, null where it is not of one cell"),
    LakeColumn("value", "number", "", "in `unit`"),
    LakeColumn("limit_value", "number", "", "in `unit`"),
    LakeColumn("unit", "text", "", "of both"),
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


def arrow_schema(columns: Sequence[LakeColumn], about: dict[str, str] | None = None) -> Any:
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
        pa.field(column.name, types[column.type], metadata={"unit": column.unit, "meaning": column.meaning})
        for column in columns
    ]
    return pa.schema(fields, metadata=about)


def name_of_table(name: str) -> str:
    """Return the file name of a table: one of `TABLES`, or `SAMPLES`."""
    if name not in TABLES and name != SAMPLES:
        raise KeyError(name)
    return f"{name}.parquet"
