"""The Protobuf messages of an MCAP export, and the schema that explains them to whoever reads the file."""

from collections.abc import Sequence
from importlib import import_module
from typing import Any

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
