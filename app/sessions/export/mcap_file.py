"""MCAP for Foxglove and its relatives, by the mcap package: a topic a field, JSON with its schema, events as a log."""

import json
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import orjson

from app.sessions.errors import ExportUnavailable
from app.sessions.export.table import Rows, SignalTable, source_of

_NUMBER = {"type": ["number", "null"]}
_LOG_SCHEMA = {
    "title": "foxglove.Log",
    "type": "object",
    "properties": {
        "timestamp": {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}},
        "level": {"type": "integer"},
        "message": {"type": "string"},
        "name": {"type": "string"},
        "file": {"type": "string"},
        "line": {"type": "integer"},
    },
}
_LEVELS = {"info": 2, "watch": 2, "warning": 3, "trip": 5}


def write_mcap(table: SignalTable, path: Path) -> None:
    """Write the file. A field of many elements is an array, null where an element was not asked for or not measured.

    Raises:
        ExportUnavailable: mcap is not installed.
    """
    try:
        mcap = import_module("mcap.writer")
    except ImportError as error:
        raise ExportUnavailable("mcap", "mcap", "mcap") from error
    fields: dict[str, list[int]] = {}
    for column, signal in enumerate(table.signals):
        fields.setdefault(signal.field, []).append(column)
    with path.open("wb") as file:
        writer = mcap.Writer(file)
        writer.start(profile="", library=f"voltwall {table.info.voltwall}")
        channels = {name: _register(writer, table, name, columns) for name, columns in fields.items()}
        for rows in table.rows():
            for time_ns, channel_id, body in _messages(table, rows, fields, channels):
                writer.add_message(channel_id, log_time=time_ns, publish_time=time_ns, data=body)
        if source := source_of(table):
            writer.add_metadata("voltwall", source)
        _write_events(writer, table)
        writer.finish()


def _register(writer: Any, table: SignalTable, field: str, columns: list[int]) -> int:
    is_array = _is_array(table, columns)
    schema = {
        "title": field,
        "type": "object",
        "properties": {
            "value": {"type": "array", "items": _NUMBER} if is_array else _NUMBER,
            "unit": {"type": "string"},
            "uptime_s": _NUMBER,
        },
    }
    schema_id = writer.register_schema(name=field, encoding="jsonschema", data=json.dumps(schema).encode())
    unit = table.signals[columns[0]].unit
    channel: int = writer.register_channel(
        topic=f"/{field}", message_encoding="json", schema_id=schema_id, metadata={"unit": unit}
    )
    return channel


def _is_array(table: SignalTable, columns: list[int]) -> bool:
    return any(table.signals[column].name.endswith("]") for column in columns)


def _messages(
    table: SignalTable, rows: Rows, fields: dict[str, list[int]], channels: dict[str, int]
) -> Iterator[tuple[int, int, bytes]]:
    prepared = []
    for field, columns in fields.items():
        values = rows.values[:, columns]
        if _is_array(table, columns):
            elements = [table.signals[column].element for column in columns]
            whole = np.full((len(values), max(elements) + 1), np.nan)
            whole[:, elements] = values
            values = whole
        sampled = np.isfinite(values).sum(axis=1) > 0
        prepared.append((channels[field], values, sampled, table.signals[columns[0]].unit, _is_array(table, columns)))
    times_ns = np.round(rows.time_s * 1e9).astype(np.int64)
    for row, time_ns in enumerate(times_ns.tolist()):
        for channel_id, values, sampled, unit, is_array in prepared:
            if sampled[row]:
                body = {
                    "value": values[row] if is_array else values[row, 0],
                    "unit": unit,
                    "uptime_s": rows.uptime_s[row],
                }
                yield time_ns, channel_id, orjson.dumps(body, option=orjson.OPT_SERIALIZE_NUMPY)


def _write_events(writer: Any, table: SignalTable) -> None:
    session = table.session
    lines = [
        (event["t_mono_ns"], _LEVELS.get(event["severity"], 2), event["code"], event["text"])
        for event in session.events()
    ]
    lines += [(marker.t_mono_ns, 2, f"marker {marker.kind}", marker.text) for marker in session.markers()]
    schema_id = writer.register_schema(
        name="foxglove.Log", encoding="jsonschema", data=json.dumps(_LOG_SCHEMA).encode()
    )
    channel_id = writer.register_channel(topic="/events", message_encoding="json", schema_id=schema_id)
    for t_mono_ns, level, name, text in sorted(lines):
        unix_s = session.unix_s(t_mono_ns)
        if (table.t_from_s or 0) <= unix_s <= (table.t_to_s or np.inf):
            sec, nsec = divmod(round(unix_s * 1e9), 10**9)
            body = {"timestamp": {"sec": sec, "nsec": nsec}, "level": level, "message": text, "name": name}
            time_ns = sec * 10**9 + nsec
            writer.add_message(channel_id, log_time=time_ns, publish_time=time_ns, data=orjson.dumps(body))
