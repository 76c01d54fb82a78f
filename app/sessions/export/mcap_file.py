"""MCAP for Foxglove, Lichtblick and their relatives: a topic a field, Protobuf with its schema, events as a log.

Protobuf, because a number that is missing in the middle of an array is a NaN there: JSON has none, and these viewers
refuse a JSON schema in which a number may be null.
"""

from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from app.sessions.errors import ExportUnavailable
from app.sessions.export.table import Rows, SignalTable, log_lines, source_of

NUMBER = "voltwall.Number"
NUMBERS = "voltwall.Numbers"
LOG = "foxglove.Log"  # https://docs.foxglove.dev/docs/visualization/message-schemas/log
_LEVELS = ("UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL")


class McapMessages:
    """Encodes samples and events.

    Attributes:
        schema: a serialized FileDescriptorSet of all messages.
    """

    def __init__(self) -> None:
        """Build the messages.

        Raises:
            ImportError: protobuf is not installed.
        """
        descriptors = import_module("google.protobuf.descriptor_pb2")
        timestamp = import_module("google.protobuf.timestamp_pb2")
        pools = import_module("google.protobuf.descriptor_pool")
        factory = import_module("google.protobuf.message_factory")
        files = descriptors.FileDescriptorSet()
        timestamp.DESCRIPTOR.CopyToProto(files.file.add())
        _describe_samples(descriptors, files.file.add())
        _describe_log(descriptors, files.file.add())
        pool = pools.DescriptorPool()
        for file in files.file:
            pool.Add(file)
        self.schema: bytes = files.SerializeToString()
        self._number, self._numbers, self._log = (
            factory.GetMessageClass(pool.FindMessageTypeByName(name)) for name in (NUMBER, NUMBERS, LOG)
        )

    def number(self, value: float, unit: str, uptime_s: float) -> bytes:
        """Return one number; NaN for an uptime that is not known."""
        return bytes(self._number(value=value, unit=unit, uptime_s=uptime_s).SerializeToString())

    def numbers(self, values: Sequence[float], unit: str, uptime_s: float) -> bytes:
        """Return an array, NaN where an element is missing."""
        return bytes(self._numbers(value=values, unit=unit, uptime_s=uptime_s).SerializeToString())

    def log(self, time_ns: int, level: int, name: str, text: str) -> bytes:
        """Return an event or a marker; `time_ns` since 1970 UTC, `level` as in foxglove.Log."""
        message = self._log(level=level, name=name, message=text)
        message.timestamp.seconds, message.timestamp.nanos = divmod(time_ns, 10**9)
        return bytes(message.SerializeToString())


def _describe_samples(descriptors: Any, file: Any) -> None:
    field = descriptors.FieldDescriptorProto
    file.name, file.package, file.syntax = "voltwall.proto", "voltwall", "proto3"
    for full_name, label in ((NUMBER, field.LABEL_OPTIONAL), (NUMBERS, field.LABEL_REPEATED)):
        message = file.message_type.add(name=full_name.removeprefix("voltwall."))
        message.field.add(name="value", number=1, type=field.TYPE_DOUBLE, label=label)
        message.field.add(name="unit", number=2, type=field.TYPE_STRING, label=field.LABEL_OPTIONAL)
        message.field.add(name="uptime_s", number=3, type=field.TYPE_DOUBLE, label=field.LABEL_OPTIONAL)


def _describe_log(descriptors: Any, file: Any) -> None:
    field = descriptors.FieldDescriptorProto
    file.name, file.package, file.syntax = "foxglove/Log.proto", "foxglove", "proto3"
    file.dependency.append("google/protobuf/timestamp.proto")
    message = file.message_type.add(name="Log")
    levels = message.enum_type.add(name="Level")
    for number, name in enumerate(_LEVELS):
        levels.value.add(name=name, number=number)
    types = {"message": field.TYPE_STRING, "name": field.TYPE_STRING, "file": field.TYPE_STRING}
    optional = {"label": field.LABEL_OPTIONAL}
    message.field.add(
        name="timestamp", number=1, type=field.TYPE_MESSAGE, type_name=".google.protobuf.Timestamp", **optional
    )
    message.field.add(name="level", number=2, type=field.TYPE_ENUM, type_name=".foxglove.Log.Level", **optional)
    for number, (name, kind) in enumerate(types.items(), start=3):
        message.field.add(name=name, number=number, type=kind, **optional)
    message.field.add(name="line", number=6, type=field.TYPE_FIXED32, **optional)


_LEVEL_OF = {"info": 2, "watch": 2, "warning": 3, "trip": 5}


def write_mcap(table: SignalTable, path: Path) -> None:
    """Write the file. A field of many elements is an array, NaN where an element was not asked for or not measured.

    Raises:
        ExportUnavailable: mcap or protobuf is not installed.
    """
    try:
        mcap = import_module("mcap.writer")
        messages = McapMessages()
    except ImportError as error:
        raise ExportUnavailable("mcap", "mcap and protobuf", "mcap") from error
    fields: dict[str, list[int]] = {}
    for column, signal in enumerate(table.signals):
        fields.setdefault(signal.field, []).append(column)
    with path.open("wb") as file:
        writer = mcap.Writer(file)
        writer.start(profile="", library=f"voltwall {table.info.voltwall}")
        schemas = {
            name: writer.register_schema(name=name, encoding="protobuf", data=messages.schema)
            for name in (NUMBER, NUMBERS, LOG)
        }
        channels = {
            field: writer.register_channel(
                topic=f"/{field}",
                message_encoding="protobuf",
                schema_id=schemas[NUMBERS if _is_array(table, columns) else NUMBER],
                metadata={"unit": table.signals[columns[0]].unit},
            )
            for field, columns in fields.items()
        }
        for rows in table.rows():
            for time_ns, channel_id, body in _samples(table, rows, fields, channels, messages):
                writer.add_message(channel_id, log_time=time_ns, publish_time=time_ns, data=body)
        if source := source_of(table):
            writer.add_metadata("voltwall", source)
        events = writer.register_channel(topic="/events", message_encoding="protobuf", schema_id=schemas[LOG])
        for time_ns, body in _events(table, messages):
            writer.add_message(events, log_time=time_ns, publish_time=time_ns, data=body)
        writer.finish()


def _is_array(table: SignalTable, columns: list[int]) -> bool:
    return any(table.signals[column].name.endswith("]") for column in columns)


def _samples(
    table: SignalTable, rows: Rows, fields: dict[str, list[int]], channels: dict[str, int], messages: McapMessages
) -> Iterator[tuple[int, int, bytes]]:
    prepared = []
    for field, columns in fields.items():
        values = rows.values[:, columns]
        is_array = _is_array(table, columns)
        if is_array:
            elements = [table.signals[column].element for column in columns]
            whole = np.full((len(values), max(elements) + 1), np.nan)
            whole[:, elements] = values
            values = whole
        sampled = np.isfinite(values).sum(axis=1) > 0
        unit = table.signals[columns[0]].unit
        prepared.append((channels[field], values if is_array else values[:, 0], sampled, unit, is_array))
    times_ns = np.round(rows.time_s * 1e9).astype(np.int64)
    for row, (time_ns, uptime_s) in enumerate(zip(times_ns.tolist(), rows.uptime_s.tolist(), strict=True)):
        for channel_id, values, sampled, unit, is_array in prepared:
            if sampled[row]:
                encode = messages.numbers if is_array else messages.number
                yield time_ns, channel_id, encode(values[row].tolist(), unit, uptime_s)


def _events(table: SignalTable, messages: McapMessages) -> Iterator[tuple[int, bytes]]:
    for line in log_lines(table):
        time_ns = round(table.session.unix_s(line.t_mono_ns) * 1e9)
        name = line.name if line.severity else f"marker {line.name}"
        yield time_ns, messages.log(time_ns, _LEVEL_OF.get(line.severity, 2), name, line.text)
