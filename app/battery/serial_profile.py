"""The `[serial]` tables of a profile: how frames and lines of a battery are read."""

from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from app.battery.fields import TABLES
from app.battery.serial import (
    LONGEST_FRAME,
    SIGNALS,
    TYPES,
    ByteOrder,
    ChargingAt,
    Checksum,
    Header,
    IndexAt,
    LengthAt,
    Parity,
    Port,
    SerialField,
    SerialFrame,
    SerialLine,
    SerialMapping,
)
from app.battery.table_reader import TableReader
from app.words import Message

T = TypeVar("T")
_SIZES = {name: int(kind[1]) for name, kind in TYPES.items()}
SENDS_S = 0.05  # between two requests, at least


class SerialTables:
    """Reads `[serial]`, `[[serial.frame]]` and `[[serial.line]]`."""

    def __init__(
        self, file: str, values: Mapping[str, Any], lines: Mapping[str, int], channels: Mapping[str, int]
    ) -> None:
        """`channels`: how many there are, by kind, where there are several."""
        self._file, self._values, self._lines, self._channels = file, values, lines, channels
        self._order: ByteOrder = "little"

    def read(self) -> SerialMapping:
        """Return how the battery is read.

        Raises:
            ProfileError: a key is missing, unknown or wrong, by its line.
        """
        table = self._table("serial", self._values)
        table.check_names(("frame", "line"))
        self._order = self._byte_order(table)
        parity: Parity = table.text("parity", "none")  # type: ignore[assignment]
        port = Port(
            baud=table.count("baud", 115_200),
            parity=parity,
            data_bits=table.count("data_bits", 8),
            stop_bits=table.number("stop_bits", 1.0),
            start=_text_bytes(table, "start"),
            stop=_text_bytes(table, "stop"),
        )
        frames = self._all("frame", self._frame)
        lines = self._all("line", self._line)
        if bool(frames) == bool(lines):
            raise table.error("frame", len(frames), Message("serial-frame-or-line"))
        return SerialMapping(port, frames, lines, table.number("period_s", 0.1))

    def _table(self, path: str, values: Any, of: str = "") -> TableReader:
        """The reader of a table; `of` names another one that has the same keys."""
        plain = path.replace("[", ".[").split(".")
        name = ".".join(part for part in plain if not part.startswith("["))
        given = values if isinstance(values, Mapping) else {}
        reader = TableReader(self._file, path, given, TABLES[of or name], self._lines)
        if not isinstance(values, Mapping):
            raise TableReader(self._file, "", {}, (), self._lines).error(path, str(values)[:60], Message("kind-table"))
        return reader

    def _all(self, name: str, read: Callable[[str, Any], T]) -> tuple[T, ...]:
        given = self._values.get(name, [])
        if not isinstance(given, list):
            table = self._table("serial", self._values)
            raise table.error(name, str(given)[:60], Message("kind-tables", name=f"serial.{name}"))
        return tuple(read(f"serial.{name}[{i}]", table) for i, table in enumerate(given))

    def _frame(self, path: str, values: Any) -> SerialFrame:
        table = self._table(path, values)
        table.check_names(("length_at", "checksum", "fields"))
        header, length = _header(table), table.count("length", 0) or None
        gap_s, length_at = table.optional_number("gap_s"), self._length_at(table)
        if not header and (gap_s is None or length is None):
            raise table.error("header", "", Message("serial-no-header"))
        if (length is None) is (length_at is None):
            raise table.error("length", length or 0, Message("serial-length-or-at"))
        frame = SerialFrame(
            name=table.text("name", path),
            header=header,
            length=length,
            length_at=length_at,
            gap_s=gap_s,
            end=_hex(table, "end"),
            checksum=self._checksum(table),
            poll=_hex(table, "poll"),
            poll_s=max(table.number("poll_s", 1.0), SENDS_S),
            fields=self._fields(table),
            line=table.line,
        )
        for field in frame.fields:
            size = _SIZES[field.type]
            last = field.at + (_words(field) - 1) * (field.stride or size) + size
            if length is not None and (last > length or field.at < -length):
                raise table.error("fields", field.name, Message("serial-beyond-frame", end=last, length=length))
        return frame

    def _line(self, path: str, values: Any) -> SerialLine:
        table = self._table(path, values)
        table.check_names(("fields", "checksum"))
        is_hex = table.flag("hex")
        return SerialLine(
            name=table.text("name", path),
            separator=table.text("separator", ","),
            pattern=table.text("pattern"),
            begin=table.text("begin"),
            end=table.text("end"),
            is_hex=is_hex,
            checksum=self._checksum(table),
            poll=_text_bytes(table, "poll"),
            poll_s=max(table.number("poll_s", 1.0), SENDS_S),
            fields=self._fields(table, has_columns=not is_hex),
            row=table.line,
        )

    def _length_at(self, table: TableReader) -> LengthAt | None:
        if "length_at" not in table.values:
            return None
        inner = self._table(f"{table.path}.length_at", table.values["length_at"])
        inner.check_names()
        return LengthAt(
            inner.count("offset", 0), inner.count("size", 1), inner.count("adds", 0), self._byte_order(inner)
        )

    def _checksum(self, table: TableReader) -> Checksum | None:
        if "checksum" not in table.values:
            return None
        inner = self._table(f"{table.path}.checksum", table.values["checksum"])
        inner.check_names()
        kind = inner.text("kind")
        if kind == "none":
            return None
        at = inner.count("at", -1)
        return Checksum(kind, inner.count("from", 0), inner.count("to", at), at, self._byte_order(inner))

    def _fields(self, table: TableReader, *, has_columns: bool = False) -> tuple[SerialField, ...]:
        given = table.values.get("fields", [])
        if not isinstance(given, list) or not given:
            raise table.error("fields", str(given)[:60], Message("serial-no-fields"))
        return tuple(
            self._field(f"{table.path}.fields[{i}]", entry, has_columns=has_columns) for i, entry in enumerate(given)
        )

    def _field(self, path: str, values: Any, *, has_columns: bool) -> SerialField:
        table = self._table(path, values, "" if has_columns else "serial.frame.fields")
        table.check_names(("index",) if has_columns else ("index", "charging"))
        of_place = self._columns(table) if has_columns else self._bytes(table)
        kind, first = SIGNALS[table.text("signal")], table.count("first", 1) - 1
        field = SerialField(
            name=table.text("name") or table.text("signal"),
            kind=kind,
            first=first,
            scale=table.number("scale", 1.0),
            offset=table.number("offset", 0.0),
            charge_is_positive=table.text("positive", "discharge") == "charge",
            invalid=table.counts("invalid") or (),
            valid_range=table.pair("valid_range"),
            equals=table.counts("equals") or (),
            mask=table.count("mask", 0),
            max_age_s=table.optional_number("max_age_s"),
            line=table.line,
            **of_place,
        )
        most = self._channels.get(kind, 1)
        if first + field.count > most and field.index is None and not field.group:
            limit = Message("serial-too-many", signal=table.text("signal"), most=most)
            raise table.error("columns" if has_columns else "count", field.count, limit)
        return field

    def _bytes(self, table: TableReader) -> dict[str, Any]:
        return {
            "type": table.text("type"),
            "at": table.count("at", 0),
            "count": table.count("count", 1),
            "stride": table.count("stride", 0),
            "byte_order": self._byte_order(table),
            "bits": table.flag("bits"),
            "index": self._index(table),
            "charging": self._charging(table),
        }

    def _columns(self, table: TableReader) -> dict[str, Any]:
        columns, group = table.counts("columns"), table.text("group")
        if "column" in table.values:
            columns = (table.count("column", 0),) * 2
        if (columns is None) is (not group):
            raise table.error("column", "", Message("serial-column-or-group"))
        if columns is not None and (len(columns) != 2 or columns[0] > columns[1]):
            raise table.error("columns", list(columns), Message("kind-pair"))
        count = 1 if columns is None else columns[1] - columns[0] + 1
        base = table.count("base", 10)
        return {
            "columns": columns,
            "count": count,
            "group": group,
            "base": base,
            "is_signed": table.flag("signed"),
            "begin": table.text("begin"),
            "end": table.text("end"),
            "index": self._line_index(table),
        }

    def _line_index(self, table: TableReader) -> IndexAt | None:
        if "index" not in table.values:
            return None
        inner = self._inner(table, "index", "serial.line.fields.index")
        inner.check_names()
        column, group = inner.count("column", 0) if "column" in inner.values else None, inner.text("group")
        if (column is None) is (not group):
            raise inner.error("column", "", Message("serial-column-or-group"))
        return IndexAt(inner.count("base", 0), column=column, group=group)

    def _index(self, table: TableReader) -> IndexAt | None:
        if "index" not in table.values:
            return None
        inner = self._inner(table, "index")
        inner.check_names()
        kind = inner.text("type", "u8")
        return IndexAt(inner.count("base", 0), inner.count("at", 0), kind, self._byte_order(inner))

    def _charging(self, table: TableReader) -> ChargingAt | None:
        if "charging" not in table.values:
            return None
        inner = self._inner(table, "charging")
        inner.check_names()
        kind, equals = inner.text("type", "u8"), inner.counts("equals") or (1,)
        return ChargingAt(inner.count("at", 0), kind, equals, inner.count("mask", 0), self._byte_order(inner))

    def _inner(self, table: TableReader, name: str, of: str = "") -> TableReader:
        """The reader of a table within a field."""
        path = f"{table.path.rpartition('[')[0]}.{name}"
        return self._table(path, table.values[name], of or f"serial.frame.fields.{name}")

    def _byte_order(self, table: TableReader) -> ByteOrder:
        order: ByteOrder = table.text("byte_order", self._order)  # type: ignore[assignment]
        return order


def _words(of: SerialField) -> int:
    return -(-of.count // (8 * _SIZES[of.type])) if of.bits else of.count


def _header(table: TableReader) -> Header:
    text = "".join(table.text("header").split())
    pairs = [text[i : i + 2] for i in range(0, len(text), 2)]
    try:
        header = tuple(None if pair == "??" else _byte(pair) for pair in pairs)
    except ValueError as error:
        raise table.error("header", text, Message("serial-hex")) from error
    if header and (all(byte is None for byte in header) or len(header) > LONGEST_FRAME):
        raise table.error("header", text, Message("serial-hex"))
    return header


def _byte(pair: str) -> int:
    if len(pair) != 2:
        raise ValueError(pair)
    return bytes.fromhex(pair)[0]


def _hex(table: TableReader, name: str) -> bytes:
    text = table.text(name)
    try:
        return bytes.fromhex(text)
    except ValueError as error:
        raise table.error(name, text[:60], Message("serial-hex")) from error


def _text_bytes(table: TableReader, name: str) -> bytes:
    """A string is text, `{hex = "DD A5"}` is bytes."""
    value = table.values.get(name, "")
    is_hex = isinstance(value, Mapping) and set(value) == {"hex"} and isinstance(value["hex"], str)
    try:
        if is_hex:
            return bytes.fromhex(value["hex"])
        if isinstance(value, str):
            return value.encode("latin-1")
    except (ValueError, UnicodeEncodeError):
        pass
    raise table.error(name, str(value)[:60], Message("serial-text-or-hex"))
