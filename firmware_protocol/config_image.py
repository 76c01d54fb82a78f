"""The configuration as an image of 420 bytes: its defaults, its limits, its values in counts and in units.

Images are immutable bytes: what changes a value returns a new image. Nothing here knows where an image is kept.
"""

import hashlib
from dataclasses import dataclass

from firmware_protocol.errors import DecodeError, EncodeError, LimitKind
from firmware_protocol.memory_map import (
    BYTE_UNUSED,
    CAN_ID_EXTENDED,
    CONFIG,
    CONFIG_FIELDS,
    CONFIG_SIZE,
    MASTER_SIZE,
    N_CAN_MESSAGES,
    NO_RESPONSE,
    RESPONSE_CHARGES,
    Field,
    element_name,
)

Image = bytes | bytearray | memoryview
Number = int | float
Value = Number | list["Value"]  # nested as the field's shape: a scalar, a list, a list of lists

MAX_ID_STANDARD = 0x7FF
MAX_ID_EXTENDED = 0x1FFFFFFF
RESPONSE_BOUNDS = f"0..{N_CAN_MESSAGES - 1}, {RESPONSE_CHARGES}..{RESPONSE_CHARGES + N_CAN_MESSAGES - 1}"

ORDERED = (  # the first may not exceed the second; strict where True; why
    ("v_cell_min", "v_cell_max", True, "no voltage would be within both limits"),
    ("v_cell_chrg", "v_cell_max", False, "charging would end in a trip"),
    ("t_cell_min", "t_cell_max", True, "no temperature would be within both limits"),
    ("i_disc_min", "i_disc_max", True, "no current would be within both limits"),
    ("i_chrg_min", "i_chrg_max", False, "no charging current would be within both limits"),
    ("fan_ramp_start", "fan_ramp_stop", True, "the ramp must rise with temperature"),
    ("fan_ramp_min", "fan_ramp_max", False, "hotter cells would get less cooling"),
)


@dataclass(frozen=True, slots=True)
class FieldError:
    """One value that breaks a limit; `value` and `limit` are in the field's unit, `offset` is its byte."""

    field: str
    element: int | None  # flat index, None for a field with one element
    value: Number
    limit: str
    offset: int
    why: str

    @property
    def message(self) -> str:
        """One line with field, value, limit and why: `v_cell_max = 4.6 V, allowed: 3..4.5 V: ...`."""
        field = CONFIG[self.field]
        unit = f" {field.unit}" if field.unit else ""
        value = f"{self.value:#x}" if field.name.endswith("_msg_id") else f"{self.value}{unit}"
        return f"{element_name(field, self.element or 0)} = {value}, allowed: {self.limit}: {self.why}"


@dataclass(frozen=True, slots=True)
class Change:
    """One element that two images hold differently; both values in the field's unit."""

    field: str
    element: int | None
    offset: int
    before: Number
    after: Number
    unit: str


def default_image() -> bytes:
    """Return the configuration that a master without a valid EEPROM starts with."""
    image = bytearray(CONFIG_SIZE)
    for field in CONFIG_FIELDS:
        default = field.default
        field.pack_into(image, default if isinstance(default, tuple) else (default or 0,))
    return bytes(image)


def canonical(image: Image) -> bytes:
    """Return the image with its padding bytes set to 0.

    Raises:
        DecodeError: it is not CONFIG_SIZE bytes long.
    """
    _check_size(image)
    out = bytearray(CONFIG_SIZE)
    for field in CONFIG_FIELDS:
        out[field.offset : field.end] = image[field.offset : field.end]
    return bytes(out)


def image_hash(image: Image) -> str:
    """Return 16 hex characters that name the image, whatever its padding holds."""
    return hashlib.sha256(canonical(image)).hexdigest()[:16]


def to_unit(field: Field, raw: int) -> Number:
    """Return a count in the field's unit: an integer where one count is one unit."""
    return raw if field.scale == 1 else float(f"{raw * field.scale:.10g}")


def to_raw(field: Field, value: Number) -> int:
    """Return the nearest count to a value in the field's unit.

    Raises:
        EncodeError: not a finite number, outside the field's range, or a fraction of what is counted in whole units.
    """
    kind: LimitKind = "buffer" if field.name == "ts" else "bounds"
    if not abs(value) < 1 << 40:  # an integer beyond it may not even be a float
        raise EncodeError(field.name, value, limit_text(field), kind)
    if field.scale == 1 and value != int(value):
        raise EncodeError(field.name, value, limit_text(field), "whole")
    raw = round(value / field.scale)
    if not _in_range(field, raw):
        raise EncodeError(field.name, value, limit_text(field), kind)
    return raw


def limit_text(field: Field) -> str:
    """Return the field's range in its unit, for people: `1.5..4 V`."""
    low, high = _range(field)
    unit = f" {field.unit}" if field.unit else ""
    return f"{to_unit(field, low):.10g}..{to_unit(field, high):.10g}{unit}"


def raw_value(image: Image, name: str) -> Value:
    """Return a field in counts, nested as its shape.

    Raises:
        EncodeError: no field has this name.
    """
    field = _field(name)
    return _nest(list(field.unpack(image)), field.shape)


def unit_value(image: Image, name: str) -> Value:
    """Return a field in its unit, nested as its shape.

    Raises:
        EncodeError: no field has this name.
    """
    field = _field(name)
    return _nest([to_unit(field, raw) for raw in field.unpack(image)], field.shape)


def with_raw(image: Image, name: str, value: Value) -> bytes:
    """Return the image with a field replaced, given in counts; whether they are in range is for `check` to say.

    Raises:
        EncodeError: no field has this name, the shape differs, or a count does not fit the field's type.
    """
    field = _field(name)
    low, high = _type_range(field)
    raws: list[int] = []
    for element, number in enumerate(_flatten(field, value)):
        if not isinstance(number, int) or not low <= number <= high:
            raise EncodeError(element_name(field, element), number, f"{low}..{high}", "counts")
        raws.append(number)
    return _replaced(image, field, raws)


def with_value(image: Image, name: str, value: Value) -> bytes:
    """Return the image with a field replaced, given in its unit and rounded to the nearest count.

    Raises:
        EncodeError: no field has this name, the shape differs, or a value is outside the field's range.
    """
    field = _field(name)
    raws: list[int] = []
    for element, number in enumerate(_flatten(field, value)):
        try:
            raws.append(to_raw(field, number))
        except EncodeError as error:
            raise EncodeError(element_name(field, element), number, error.bounds, error.kind) from None
    return _replaced(image, field, raws)


def check(image: Image) -> list[FieldError]:
    """Return the errors for which the master refuses this image, in order of offset; empty if it is valid.

    Beyond each field's range: CAN ids fit 11 or 29 bits, table entries lie inside the struct, received bytes never
    land in the configuration itself, answers name a message, and a pair of limits is the right way round.

    Raises:
        DecodeError: it is not CONFIG_SIZE bytes long.
    """
    _check_size(image)
    errors = [
        field_error(field, element, raw, *broken)
        for field in CONFIG_FIELDS
        for element, raw in enumerate(field.unpack(image))
        if (broken := _element_limit(field, raw)) is not None
    ]
    for low_name, high_name, is_strict, why in ORDERED:
        low, high = CONFIG[low_name], CONFIG[high_name]
        low_raw, high_raw = low.unpack(image)[0], high.unpack(image)[0]
        if low_raw > high_raw or (is_strict and low_raw == high_raw):
            relation = "below" if is_strict else "at most"
            limit = f"{relation} {high_name} = {to_unit(high, high_raw)} {high.unit}"
            errors.append(field_error(low, 0, low_raw, limit, why))
    return sorted(errors, key=lambda error: error.offset)


def difference(before: Image, after: Image) -> list[Change]:
    """Return the elements in which two images differ, in order of offset; padding does not count.

    Raises:
        DecodeError: one is not CONFIG_SIZE bytes long.
    """
    _check_size(before)
    _check_size(after)
    return [
        Change(
            field.name,
            element if field.shape else None,
            field.offset + element * field.item_size,
            to_unit(field, old),
            to_unit(field, new),
            field.unit,
        )
        for field in CONFIG_FIELDS
        for element, (old, new) in enumerate(zip(field.unpack(before), field.unpack(after), strict=True))
        if old != new
    ]


_OUT_OF_RANGE = "limit of the master"
_WHY_OUT_OF_RANGE = {"ts": "size of the current sample buffer"}


def _element_limit(field: Field, raw: int) -> tuple[str, str] | None:
    """Return the limit that a count violates, and its reason; None if it violates none."""
    if not _in_range(field, raw):
        return limit_text(field), _WHY_OUT_OF_RANGE.get(field.name, _OUT_OF_RANGE)
    if field.name in ("can_tx_msg_id", "can_rx_msg_id"):
        is_extended = bool(raw & CAN_ID_EXTENDED)
        highest = MAX_ID_EXTENDED if is_extended else MAX_ID_STANDARD
        if raw & ~CAN_ID_EXTENDED > highest:
            return f"0..{highest:#x}", "range of a 29-bit ID" if is_extended else "range of an 11-bit ID"
    if field.name == "can_tx_msg_data" and raw != BYTE_UNUSED and raw >= MASTER_SIZE:
        return f"0..{MASTER_SIZE - 1}, or {BYTE_UNUSED}", "end of the memory map"
    if field.name == "can_rx_msg_data" and raw != BYTE_UNUSED and not CONFIG_SIZE <= raw < MASTER_SIZE:
        limit = f"{CONFIG_SIZE}..{MASTER_SIZE - 1}, or {BYTE_UNUSED}"
        return limit, "a CAN message must not write the configuration"
    if field.name == "can_rx_msg_response" and raw != NO_RESPONSE and raw & ~RESPONSE_CHARGES >= N_CAN_MESSAGES:
        return f"{RESPONSE_BOUNDS}, or {NO_RESPONSE}", "only eight messages can be a response"
    return None


def field_error(field: Field, element: int, raw: int, limit: str, why: str) -> FieldError:
    """Return the error of one element, its count given."""
    offset = field.offset + element * field.item_size
    return FieldError(field.name, element if field.shape else None, to_unit(field, raw), limit.strip(), offset, why)


def _type_range(field: Field) -> tuple[int, int]:
    bits = 8 * field.item_size
    return (-(1 << bits - 1), (1 << bits - 1) - 1) if field.fmt.islower() else (0, (1 << bits) - 1)


def _range(field: Field) -> tuple[int, int]:
    low, high = _type_range(field)
    return (low if field.minimum is None else field.minimum, high if field.maximum is None else field.maximum)


def _in_range(field: Field, raw: int) -> bool:
    low, high = _range(field)
    return low <= raw <= high


def _field(name: str) -> Field:
    if name not in CONFIG:
        raise EncodeError("field", name, "", "field")
    return CONFIG[name]


def _check_size(image: Image) -> None:
    if len(image) != CONFIG_SIZE:
        raise DecodeError("configuration", f"{len(image)} bytes, not {CONFIG_SIZE}")


def _replaced(image: Image, field: Field, raws: list[int]) -> bytes:
    out = bytearray(image)
    field.pack_into(out, tuple(raws))
    return bytes(out)


def _nest(values: list[Value], shape: tuple[int, ...]) -> Value:
    if not shape:
        return values[0]
    step = len(values) // shape[0]
    return [_nest(values[i * step : (i + 1) * step], shape[1:]) for i in range(shape[0])]


def _flatten(field: Field, value: Value) -> list[Number]:
    """Return the elements in order; EncodeError where the nesting is not the field's shape."""

    def walk(part: Value, shape: tuple[int, ...]) -> list[Number]:
        if not shape:
            if isinstance(part, bool) or not isinstance(part, int | float):
                raise EncodeError(field.name, part, "", "number")
            return [part]
        if not isinstance(part, list | tuple) or len(part) != shape[0]:
            raise EncodeError(field.name, part, " by ".join(map(str, field.shape)), "array")
        return [number for item in part for number in walk(item, shape[1:])]

    return walk(value, field.shape)
