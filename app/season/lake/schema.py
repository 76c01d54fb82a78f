"""The tables of the season lake: every column's type, unit and meaning..

The documentation (`docs/reference/season-lake.md`) and the metadata of the Parquet files are made from these tables.
Types are those of `TYPES`; a column that is not measured or not known is null, never 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

from app.errors import ExtraMissing
from app.words import Message

LAKE_VERSION: Final = 6  # a lake of an older number is made again from its sessions
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
    LakeColumn("car", "text", "", "name of the car, as in the folder name"),
    LakeColumn("season", "text", "", "season in the metadata, otherwise the year of the start (UTC)"),
    LakeColumn("session", "text", "", "session ID, which is the file name"),
)
_START = LakeColumn("start_time", "time", "", "start of the session or the lap")
_ENERGIES = (
    LakeColumn("energy_out_wh", "number", "Wh", "energy discharged; missing if a cell voltage was missing under load"),
    LakeColumn("energy_in_wh", "number", "Wh", "energy charged, including regeneration; positive; missing as above"),
)
_CHARGES = (
    LakeColumn("charge_out_ah", "number", "Ah", "charge discharged"),
    LakeColumn("charge_in_ah", "number", "Ah", "charge added; positive"),
)

SESSIONS: Final = (
    *WHERE,
    LakeColumn("name", "text", "", "session name"),
    _START,
    LakeColumn("end_time", "time", "", "time of the last sample"),
    LakeColumn("duration_s", "number", "s", "from start to end"),
    LakeColumn("driving_s", "number", "s", "time with a current above 2 A"),
    LakeColumn("simulated", "flag", "", "true for the simulated car"),
    LakeColumn("battery", "text", "", "name of the battery's profile"),
    LakeColumn("n_cells", "count", "", "number of cells"),
    LakeColumn("segments", "text", "", "cells of each pack, as a JSON list"),
    LakeColumn("n_laps", "count", "", "number of whole laps"),
    LakeColumn("laps_from", "text", "", "source of the laps, `settled`, `markers` or `pattern`"),
    *_ENERGIES,
    *_CHARGES,
    LakeColumn("current_max_a", "number", "A", "highest current, positive on discharge"),
    LakeColumn("power_max_w", "number", "W", "highest power"),
    LakeColumn("cell_file", "text", "", "cell model used for the estimates"),
    LakeColumn("cell_file_of_then", "flag", "", "true if the session contains that cell model"),
    LakeColumn("recorded_by", "text", "", "version of Voltwall that recorded it"),
    LakeColumn("metadata", "text", "", "the session's metadata and tags, as a JSON object"),
    LakeColumn("layout", "text", "", "equal for sessions with the same columns in `samples`"),
    LakeColumn("built_by", "text", "", "version of Voltwall that built these rows"),
    LakeColumn("source_file", "text", "", "path of the session's file when it was read"),
    LakeColumn("source_state", "text", "", "modification time and size of the file; if they change, it is read again"),
)
LAPS: Final = (
    *WHERE,
    LakeColumn("lap", "count", "", "from 1"),
    _START,
    LakeColumn("duration_s", "number", "s", "time of the lap"),
    LakeColumn("driver", "text", "", "driver; empty if unknown"),
    LakeColumn("note", "text", "", "note of the crew"),
    LakeColumn("counts", "flag", "", "false for laps left out of comparisons (out-lap, incident, partial lap)"),
    *_ENERGIES,
    LakeColumn("power_mean_w", "number", "W", "mean power"),
    LakeColumn("power_max_w", "number", "W", "highest power"),
    LakeColumn("power_min_w", "number", "W", "strongest regeneration, negative"),
    LakeColumn("current_rms_a", "number", "A", "root mean square of the current"),
    LakeColumn("soc_used", "number", "1", "mean SOC at the start minus at the end"),
    LakeColumn("temperature_rise_k", "number", "K", "rise of the mean cell temperature"),
    LakeColumn("temperature_max_degc", "number", "degC", "temperature of the hottest cell"),
    LakeColumn("temperature_max_cell", "count", "", "index of the hottest cell"),
    LakeColumn("voltage_min_v", "number", "V", "lowest cell voltage"),
    LakeColumn("weakest_cell", "count", "", "index of that cell"),
)
CELLS: Final = (
    *WHERE,
    LakeColumn("lap", "count", "", f"from 1; {WHOLE} for the whole session, including the time between laps"),
    LakeColumn("cell", "count", "", "index from 0 through the packs in order"),
    LakeColumn("pack", "count", "", "pack number from 1, as on the pages"),
    LakeColumn("cell_in_pack", "count", "", "cell number in the pack from 1, as on the pages"),
    _START,
    LakeColumn("duration_s", "number", "s", "duration of the session or the lap"),
    LakeColumn("voltage_min_v", "number", "V", "lowest voltage"),
    LakeColumn("voltage_max_v", "number", "V", "highest voltage"),
    *_ENERGIES,
    *_CHARGES,
    LakeColumn("resistance_ohm", "number", "ohm", "slope of voltage over current, including the busbar joint"),
    LakeColumn("resistance_sigma_ohm", "number", "ohm", "its standard deviation"),
    LakeColumn(
        "resistance_factor",
        "number",
        "1",
        "resistance relative to the cell model at the same temperature and SOC; only in rows of whole sessions",
    ),
    LakeColumn("resistance_factor_sigma", "number", "1", "its standard deviation"),
    LakeColumn("sag_v", "number", "V", "mean voltage below the mean of all cells at currents above 50 A"),
    LakeColumn("temperature_first_degc", "number", "degC", "first temperature"),
    LakeColumn("temperature_mean_degc", "number", "degC", "mean over time"),
    LakeColumn("temperature_max_degc", "number", "degC", "highest temperature"),
    LakeColumn("soc_first", "number", "1", "first estimate of the SOC"),
    LakeColumn("soc_last", "number", "1", "last estimate of the SOC"),
    LakeColumn("soc_mean", "number", "1", "mean over time"),
    LakeColumn("soc_used", "number", "1", "first less last"),
    LakeColumn("lowest_s", "number", "s", "driving time as the lowest cell"),
    LakeColumn(
        "near_v_min_s", "number", "s", "time within 0.2 V of the undervoltage limit of the session, or below it"
    ),
    LakeColumn(
        "near_v_max_s", "number", "s", "time within 0.02 V of the overvoltage limit of the session, or above it"
    ),
    LakeColumn(
        "near_t_max_s", "number", "s", "time within 5 K of the overtemperature limit of the session, or above it"
    ),
    LakeColumn("balancing_s", "number", "s", "balancing time"),
    LakeColumn(
        "bled_v_s",
        "number",
        "V s",
        "integral of the voltage while balancing; divided by the resistance it is the charge removed",
    ),
    LakeColumn("bled_ah", "number", "Ah", "charge removed by balancing, if the profile has `bleed_ohm`"),
    LakeColumn("missing", "count", "", "samples without a voltage"),
    LakeColumn(
        "first_rest_time",
        "time",
        "",
        "end of the first rest of the session; rest values are only in rows of whole sessions",
    ),
    LakeColumn("first_rest_v", "number", "V", "voltage at that time"),
    LakeColumn("first_rest_soc", "number", "1", "SOC at that time, from voltage and cell model"),
    LakeColumn("last_rest_time", "time", "", "end of the last rest"),
    LakeColumn("last_rest_v", "number", "V", "voltage at that time"),
    LakeColumn("last_rest_soc", "number", "1", "SOC at that time, from voltage and cell model"),
    LakeColumn("counted_soc", "number", "1", "SOC change between the two rests that are farthest apart in SOC"),
    LakeColumn("counted_soc_sigma", "number", "1", "its standard deviation"),
    LakeColumn("counted_ah", "number", "Ah", "charge counted between them"),
    LakeColumn("counted_ah_sigma", "number", "Ah", "its standard deviation"),
    LakeColumn("capacity_ah", "number", "Ah", "capacity from this session alone, counted_ah / counted_soc"),
    LakeColumn("capacity_sigma_ah", "number", "Ah", "its standard deviation"),
    LakeColumn("findings", "text", "", "codes of the findings of the cell, separated by spaces; empty if none"),
)
EVENTS: Final = (
    *WHERE,
    LakeColumn("time", "time", "", "time of the event by the session clock"),
    LakeColumn("lap", "count", "", "lap of the event; null between laps"),
    LakeColumn("code", "text", "", "code of the event (reference/alarms.md)"),
    LakeColumn("severity", "text", "", "`info`, `watch`, `warning` or `trip`"),
    LakeColumn("text", "text", "", "event text in English"),
    LakeColumn("cell", "count", "", "index from 0; null if the event is not about a single cell"),
    LakeColumn("value", "number", "", "measured value, in `unit`"),
    LakeColumn("limit_value", "number", "", "limit, in `unit`"),
    LakeColumn("unit", "text", "", "unit of value and limit"),
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
