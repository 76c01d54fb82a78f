"""A configuration as a JSON file for people and for git: units, comments, one value a line, always in the same order.

What is not a plain value is a CAN message, with its bytes as offsets and a comment that names them. A file of the first
memory map is converted when it is read: its `ts` is the present telemetry period, and `ts` gets its default.
"""

import json
from dataclasses import dataclass
from typing import Any

from app.errors import ConfigError, limit_of
from app.words import Message, Quantity
from firmware_protocol.can_tables import (
    RxMessage,
    TxMessage,
    rx_messages,
    tx_messages,
    with_rx_messages,
    with_tx_messages,
)
from firmware_protocol.config_image import canonical, unit_value, with_value
from firmware_protocol.dbc import signals
from firmware_protocol.errors import EncodeError
from firmware_protocol.memory_map import (
    BYTE_UNUSED,
    CAN_DATA_BYTES,
    CONFIG,
    CONFIG_FIELDS,
    CONFIG_SIZE,
    MAP_HASH,
    N_CAN_MESSAGES,
)
from firmware_protocol.older_maps import FIRST_MAP, is_known

FORMAT = "voltwall configuration"
FORMAT_VERSION = 1
MAX_BYTES = 200_000
_MASKS = ("can_tx_msg_en_startup", "can_rx_msg_en_startup")
PLAIN = tuple(field for field in CONFIG_FIELDS if not field.shape and field.name not in _MASKS)
_TX_KEYS = {"message", "on_from_start", "id", "extended", "period_ms", "length", "bytes"}
_RX_KEYS = {"message", "on_from_start", "id", "extended", "timeout_ms", "answer", "charges", "length", "bytes"}


@dataclass(frozen=True, slots=True)
class SavedConfiguration:
    """A named configuration; `version` counts from 1."""

    name: str
    version: int
    comment: str
    saved_by: str
    saved_at: str  # ISO 8601, UTC
    image: bytes
    converted_from: str | None = None  # the memory map that its values were of; the image is of the present one

    @property
    def origin(self) -> str:
        """Return the origin that a record of a write names: name, version, and the map that it was converted from."""
        converted = "" if self.converted_from is None else f", converted from map {self.converted_from}"
        return f"{self.name}@{self.version}{converted}"


def profile_text(profile: SavedConfiguration) -> str:
    """Return the file's text."""
    head = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "name": profile.name,
        "version": profile.version,
        "comment": profile.comment,
        "saved_by": profile.saved_by,
        "saved_at": profile.saved_at,
        "memory_map": MAP_HASH.hex(),
    } | ({} if profile.converted_from is None else {"converted_from": profile.converted_from})
    values = {
        field.name: {"value": unit_value(profile.image, field.name), "unit": field.unit, "comment": field.meaning}
        for field in PLAIN
    }
    lines = ["{"]
    lines += [f"  {json.dumps(key)}: {_line(value)}," for key, value in head.items()]
    lines += ['  "values": {', ",\n".join(f"    {json.dumps(k)}: {_line(v)}" for k, v in values.items()), "  },"]
    lines += ['  "can_sent": [', ",\n".join(f"    {_line(_tx_json(m))}" for m in tx_messages(profile.image)), "  ],"]
    lines += ['  "can_received": [', ",\n".join(f"    {_line(_rx_json(m))}" for m in rx_messages(profile.image)), "  ]"]
    return "\n".join([*lines, "}", ""])


def _line(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)


def _shared_json(message: TxMessage | RxMessage) -> dict[str, Any]:
    return {
        "message": message.index + 1,
        "on_from_start": message.enabled,
        "id": f"0x{message.can_id:0{8 if message.is_extended else 3}X}",
        "extended": message.is_extended,
    }


def _bytes_json(message: TxMessage | RxMessage) -> dict[str, Any]:
    return {
        "length": message.length,
        "bytes": [None if offset == BYTE_UNUSED else offset for offset in message.data_offsets],
        "comment": ", ".join(signal.name for signal in signals(message)),
    }


def _tx_json(message: TxMessage) -> dict[str, Any]:
    return _shared_json(message) | {"period_ms": message.period_ms} | _bytes_json(message)


def _rx_json(message: RxMessage) -> dict[str, Any]:
    answer = None if message.response is None else message.response + 1
    own = {"timeout_ms": message.timeout_ms, "answer": answer} | ({"charges": True} if message.charges else {})
    return _shared_json(message) | own | _bytes_json(message)


def is_profile(document: object) -> bool:
    """True where a JSON document says that it is a profile."""
    return isinstance(document, dict) and document.get("format") == FORMAT


def parse_profile(text: str | bytes) -> SavedConfiguration:
    """Return the profile in a file's text.

    Raises:
        ConfigError: names the field, its value and what it has to be. Whether its values make sense together is for
            `config_rules.review` to say.
    """
    if len(text) > MAX_BYTES:
        raise ConfigError(
            "profile", Message("bytes", count=len(text)), Message("at-most", value=Quantity(MAX_BYTES, ""))
        )
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ConfigError("profile", Message("text"), Message("not-json", error=str(error))) from error
    return profile_of(document)


def profile_of(document: object) -> SavedConfiguration:
    """Return the profile in a parsed JSON document; ConfigError as parse_profile."""
    if not isinstance(document, dict) or not is_profile(document):
        raise ConfigError("format", _shown(document), Message("json-object", format=repr(FORMAT)))
    if document.get("format_version") != FORMAT_VERSION:
        raise ConfigError("format_version", document.get("format_version"), f"{FORMAT_VERSION}")
    memory_map = document.get("memory_map")
    if not isinstance(memory_map, str) or not is_known(memory_map):
        limit = Message("other-memory-map", map_hash=MAP_HASH.hex())
        raise ConfigError("memory_map", _shown(memory_map), limit)
    version = document.get("version")
    if isinstance(version, bool) or not isinstance(version, int) or version < 1:
        raise ConfigError("version", _shown(version), Message("whole-number-from", low=1))
    try:
        image = _image(document)
    except EncodeError as error:
        raise ConfigError(error.field, error.value, limit_of(error)) from error
    texts = {key: document.get(key, "") for key in ("name", "comment", "saved_by", "saved_at")}
    for key, value in texts.items():
        if not isinstance(value, str):
            raise ConfigError(key, _shown(value), Message("a-text"))
    converted_from = document.get("converted_from") if memory_map == MAP_HASH.hex() else memory_map
    if converted_from is not None and (not isinstance(converted_from, str) or not is_known(converted_from)):
        raise ConfigError("converted_from", _shown(converted_from), Message("other-memory-map", map_hash=FIRST_MAP))
    return SavedConfiguration(version=version, image=image, converted_from=converted_from, **texts)


def _image(document: dict[str, Any]) -> bytes:
    image = bytes(CONFIG_SIZE)
    values = document.get("values")
    if not isinstance(values, dict):
        raise ConfigError("values", _shown(values), Message("value-for-every-field"))
    names = {field.name for field in PLAIN}
    if document["memory_map"] == FIRST_MAP:
        names.remove("telemetry_period")
    for name in values:
        if name not in names:
            raise ConfigError(f"values.{name}", Message("given"), Message("no-config-field"))
    if document["memory_map"] == FIRST_MAP:
        values = values | {"telemetry_period": values.get("ts"), "ts": {"value": CONFIG["ts"].default}}
    for field in PLAIN:
        entry = values.get(field.name)
        if not isinstance(entry, dict) or "value" not in entry:
            raise ConfigError(f"values.{field.name}", _shown(entry), Message("value-and-unit"))
        if entry.get("unit", field.unit) != field.unit:
            raise ConfigError(f"values.{field.name}.unit", _shown(entry["unit"]), field.unit or Message("none"))
        image = with_value(image, field.name, entry["value"])
    sent = [_tx(entry, i) for i, entry in enumerate(_eight(document, "can_sent"))]
    received = [_rx(entry, i) for i, entry in enumerate(_eight(document, "can_received"))]
    return canonical(with_rx_messages(with_tx_messages(image, sent), received))


def _eight(document: dict[str, Any], key: str) -> list[Any]:
    rows = document.get(key)
    if not isinstance(rows, list) or len(rows) != N_CAN_MESSAGES:
        raise ConfigError(key, _shown(rows), Message("list-of-messages", count=N_CAN_MESSAGES))
    return rows


class _Row:
    """One message's values with their types checked."""

    def __init__(self, entry: object, where: str, index: int, keys: set[str]) -> None:
        self._where = f"{where}[{index}]"
        if not isinstance(entry, dict):
            raise ConfigError(self._where, _shown(entry), Message("an-object"))
        for key in entry:
            if key not in keys | {"comment"}:
                raise ConfigError(f"{self._where}.{key}", Message("given"), Message("no-such-value"))
        self._entry = entry
        if self.number("message", N_CAN_MESSAGES) != index + 1:
            raise ConfigError(
                f"{self._where}.message", entry.get("message"), Message("messages-in-order", number=index + 1)
            )

    def shared(self, index: int) -> dict[str, Any]:
        """Return what both kinds of message have."""
        return {
            "index": index,
            "enabled": self.truth("on_from_start"),
            "can_id": self.can_id(),
            "is_extended": self.truth("extended"),
            "length": self.number("length", CAN_DATA_BYTES),
            "data_offsets": self.offsets(),
        }

    def number(self, key: str, highest: int) -> int:
        value = self._entry.get(key)
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= highest:
            raise ConfigError(f"{self._where}.{key}", _shown(value), Message("whole-number", bounds=f"0..{highest}"))
        return value

    def truth(self, key: str) -> bool:
        value = self._entry.get(key)
        if not isinstance(value, bool):
            raise ConfigError(f"{self._where}.{key}", _shown(value), Message("true-or-false"))
        return value

    def can_id(self) -> int:
        value = self._entry.get("id")
        try:
            number = int(value, 16) if isinstance(value, str) else self.number("id", 0x1FFFFFFF)
        except ValueError:
            number = -1
        highest = 0x1FFFFFFF if self.truth("extended") else 0x7FF
        if not 0 <= number <= highest:
            raise ConfigError(f"{self._where}.id", _shown(value), Message("hexadecimal", bounds=f"0x0..{highest:#x}"))
        return number

    def offsets(self) -> tuple[int, ...]:
        value = self._entry.get("bytes")
        if not isinstance(value, list) or len(value) != CAN_DATA_BYTES:
            raise ConfigError(f"{self._where}.bytes", _shown(value), Message("list-of-offsets", count=CAN_DATA_BYTES))
        for offset in value:
            if offset is not None and (type(offset) is not int or not 0 <= offset <= BYTE_UNUSED):
                raise ConfigError(f"{self._where}.bytes", _shown(offset), Message("an-offset"))
        return tuple(BYTE_UNUSED if offset is None else offset for offset in value)

    def answer(self) -> int | None:
        if self._entry.get("answer") is None:
            return None
        number = self.number("answer", N_CAN_MESSAGES)
        if not number:
            raise ConfigError(f"{self._where}.answer", number, Message("null-or-message", count=N_CAN_MESSAGES))
        return number - 1


def _tx(entry: object, index: int) -> TxMessage:
    row = _Row(entry, "can_sent", index, _TX_KEYS)
    return TxMessage(**row.shared(index), period_ms=row.number("period_ms", CONFIG["can_tx_msg_timing"].maximum or 0))


def _rx(entry: object, index: int) -> RxMessage:
    row = _Row(entry, "can_received", index, _RX_KEYS)
    timeout_ms = row.number("timeout_ms", CONFIG["can_rx_msg_timeout"].maximum or 0)
    charges = isinstance(entry, dict) and "charges" in entry and row.truth("charges")
    return RxMessage(**row.shared(index), timeout_ms=timeout_ms, response=row.answer(), charges=charges)


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:60] + "..."
