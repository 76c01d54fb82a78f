"""Rules of a configuration as a whole: fields against each other and the cell.

Errors block a write. Warnings need a reason, once: one that is in force already is shown and not asked for again.
Notices, of a protection that would trip later, need one on the page.
The master knows none of this but the ranges; what it accepts is `firmware_protocol.config_image.check`.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache

from app.configuration.can_rules import can_findings
from app.configuration.issue import ConfigIssue, Level, finding
from app.estimation.cell_model.circuit import CellModel
from app.words import Message, Quantity, Text
from firmware_protocol.config_image import ORDERED, RESPONSE_BOUNDS, FieldError, check, to_unit, with_raw
from firmware_protocol.memory_map import (
    BYTE_UNUSED,
    CONFIG,
    CONFIG_FIELDS,
    CONFIG_SIZE,
    MASTER_SIZE,
    NO_RESPONSE,
    Field,
)
from firmware_protocol.schedule import FAST_WINDOWS, data_frame_time_s

RULES_T_MAX_DEGC = 60.0  # Formula Student rules, EV 5.8: 60 degC, or the data sheet's limit where that is lower
ADC_MAX = 40950  # tenths of a count
ADC_MIDDLE = 20475
OFFSET_TOLERANCE = 0.05  # relative offset from the middle of the range; a sensor further off is unplugged or broken
CHARGE_MARGIN_V = 0.01  # what a measurement may be off, between the end of charge and the trip
CAPACITY_TOLERANCE = 0.2
PROTECTION = {  # the limits at which the master trips, and whether a higher one is looser
    "v_cell_min": False,
    "v_cell_max": True,
    "t_cell_min": False,
    "t_cell_max": True,
    "i_disc_min": False,
    "i_disc_max": True,
    "i_chrg_min": False,
    "i_chrg_max": True,
}

_WHY_OF_MASTER = {  # what the master itself refuses: the fixed reasons of `check`
    "limit of the master": Message("master-takes-nothing-else"),
    "size of the current sample buffer": Message("current-buffer"),
    "range of an 11-bit ID": Message("short-id-ends"),
    "range of a 29-bit ID": Message("long-id-ends"),
    "a CAN message must not write the configuration": Message("may-not-write-config"),
    "only eight messages can be a response": Message("eight-messages"),
    "end of the memory map": Message("struct-ends"),
    "charging would end in a trip": Message("charging-would-trip"),
    "no voltage would be within both limits": Message("no-voltage-inside"),
    "no temperature would be within both limits": Message("no-temperature-inside"),
    "no current would be within both limits": Message("no-current-inside"),
    "no charging current would be within both limits": Message("no-charging-current-inside"),
    "the ramp must rise with temperature": Message("ramp-has-to-rise"),
    "hotter cells would get less cooling": Message("hotter-get-less-air"),
}
_LIMITS_OF_MASTER = {  # the limits with words in them, by field
    "can_tx_msg_data": Message("or-unused", bounds=f"0..{MASTER_SIZE - 1}", unused=BYTE_UNUSED),
    "can_rx_msg_data": Message("or-unused", bounds=f"{CONFIG_SIZE}..{MASTER_SIZE - 1}", unused=BYTE_UNUSED),
    "can_rx_msg_response": Message("or-unused", bounds=RESPONSE_BOUNDS, unused=NO_RESPONSE),
}


@dataclass(frozen=True, slots=True)
class Context:
    """The cell and the measured CAN periods that a configuration is judged against."""

    cell: CellModel
    measured_period_s: Mapping[int, float] | None = None  # measured period by CAN id, bit 31 for 29-bit ids [s]


class _Values:
    """The image's numbers in units."""

    def __init__(self, image: bytes) -> None:
        self._image = image

    def __getitem__(self, name: str) -> float:
        field = CONFIG[name]
        return to_unit(field, field.unpack(self._image)[0])


def review(image: bytes, context: Context) -> list[ConfigIssue]:
    """Return what is wrong in an image, errors first, each in order of offset.

    Raises:
        DecodeError: it is not 420 bytes long.
    """
    issues = [_refused(image, error) for error in check(image)]
    if not issues:  # the rest is judged on values that can be
        issues = [*_cell(image, context.cell), *_current(image, context.cell), *_fans_and_line(image)]
        issues += can_findings(image, context.measured_period_s or {})
    return sorted(issues, key=lambda f: (f.level != "error", f.error.offset))


def review_change(before: bytes, after: bytes, context: Context, stored: bytes | None = None) -> list[ConfigIssue]:
    """Return the findings of an image that would replace another; warnings that stand already are marked.

    Args:
        before: what is in force.
        after: what would be.
        context: what both are judged against.
        stored: what the EEPROM holds, where that is known: a limit that goes back to it needs no new reason.
    """
    standing = {_identity(f) for f in review(before, context)}
    issues = [f.stands() if _identity(f) in standing else f for f in review(after, context)]
    brp = CONFIG["can_brp"]
    if before[brp.offset] != after[brp.offset]:
        why = Message("bus-has-to-change")
        issues.append(
            finding("warning", "bit-rate", after, "can_brp", 0, Message("as-in-force", value=before[brp.offset]), why)
        )
    asked = {f.error.field for f in issues if f.needs_reason}
    return [*issues, *(f for f in _loosened(before, after, stored) if f.error.field not in asked)]


def _loosened(before: bytes, after: bytes, stored: bytes | None) -> Iterator[ConfigIssue]:
    """Limits of the protection by which the master would trip later than now, and than what it would start with."""
    for name, is_upper in PROTECTION.items():
        values = [_Values(image)[name] for image in (before, stored) if image is not None]
        loosest, wanted = (max if is_upper else min)(values), _Values(after)[name]
        if (wanted > loosest) if is_upper else (wanted < loosest):
            limit = Message("as-in-force", value=Quantity(_Values(before)[name], CONFIG[name].unit))
            yield finding("notice", "looser", after, name, 0, limit, Message("protects-later"))


def _identity(issue: ConfigIssue) -> tuple[object, ...]:
    error = issue.error
    return issue.code, error.field, error.element, error.value


def _cell(image: bytes, cell: CellModel) -> Iterator[ConfigIssue]:
    """Cell limits against the data sheet and the rules."""
    value, sheet = _Values(image), cell.limits
    says = Message("data-sheet-ends", cell=cell.name)
    if value["v_cell_max"] > cell.v_max_v:
        yield finding("error", "data-sheet", image, "v_cell_max", 0, _at_most(cell.v_max_v, "V"), says)
    if value["v_cell_min"] < cell.v_min_v:
        yield finding("error", "data-sheet", image, "v_cell_min", 0, _at_least(cell.v_min_v, "V"), says)
    if value["v_cell_min"] >= value["v_cell_chrg"]:
        limit: Text = Message("below-field", field="v_cell_chrg", value=Quantity(value["v_cell_chrg"], "V"))
        yield finding("error", "order", image, "v_cell_min", 0, limit, Message("full-counts-as-empty"))
    highest = value["v_cell_max"] - CHARGE_MARGIN_V
    if value["v_cell_chrg"] > highest + 1e-9:
        level: Level = "error" if value["v_cell_chrg"] >= value["v_cell_max"] else "warning"
        margin = Quantity(CHARGE_MARGIN_V * 1000, "mV")
        limit = Message("margin-below-field", margin=margin, field="v_cell_max", value=Quantity(highest, "V"))
        yield finding(level, "charge-margin", image, "v_cell_chrg", 0, limit, Message("charging-would-trip"))
    t_max = (
        RULES_T_MAX_DEGC if sheet.temperature_max_degc is None else min(RULES_T_MAX_DEGC, sheet.temperature_max_degc)
    )
    if value["t_cell_max"] > t_max:
        why = Message("rules-allow", limit=Quantity(RULES_T_MAX_DEGC, "degC"))
        yield finding("error", "rules", image, "t_cell_max", 0, _at_most(t_max, "degC"), why)
    if sheet.temperature_min_degc is not None and value["t_cell_min"] < sheet.temperature_min_degc:
        limit = _at_least(sheet.temperature_min_degc, "degC")
        yield finding("error", "data-sheet", image, "t_cell_min", 0, limit, says)
    if abs(value["c_avg"] - cell.capacity_ah) > CAPACITY_TOLERANCE * cell.capacity_ah:
        limit = Message("within-of", share=Quantity(20, "%"), value=Quantity(cell.capacity_ah, "Ah"))
        why = Message("another-cell", cell=cell.name)
        yield finding("warning", "other-cell", image, "c_avg", 0, limit, why)


def measured_range_a(image: bytes) -> tuple[float, float]:
    """Return the lowest and highest current that the sensor can measure with the gain and offset of an image [A]."""
    gain, offset = CONFIG["i_gain"].unpack(image)[0], CONFIG["i_offset"].unpack(image)[0]
    return -offset * gain / 5000 / 100, (ADC_MAX - offset) * gain / 5000 / 100


def _current(image: bytes, cell: CellModel) -> Iterator[ConfigIssue]:
    """The window of currents against the sensor, the cell and sense."""
    value, sheet = _Values(image), cell.limits
    low_a, high_a = measured_range_a(image)
    ends = Message("sensor-ends")
    if value["i_disc_max"] >= high_a:
        yield finding("error", "sensor", image, "i_disc_max", 0, _below(high_a), ends)
    if value["i_disc_min"] <= low_a:
        yield finding("error", "sensor", image, "i_disc_min", 0, Message("above", value=Quantity(low_a, "A", 1)), ends)
    if value["i_chrg_max"] >= -low_a:
        yield finding("error", "sensor", image, "i_chrg_max", 0, _below(-low_a), ends)
    if value["i_disc_max"] == 0:
        yield finding(
            "error",
            "window",
            image,
            "i_disc_max",
            0,
            Message("above", value=Quantity(0.0, "A")),
            Message("car-could-not-drive"),
        )
    if sheet.charge_max_a is not None and value["i_chrg_max"] > sheet.charge_max_a:
        why = Message("data-sheet-ends", cell=cell.name)
        yield finding("error", "data-sheet", image, "i_chrg_max", 0, _at_most(sheet.charge_max_a, "A"), why)
    if sheet.discharge_max_a is not None and value["i_disc_max"] > sheet.discharge_max_a:
        why = Message("pulses-may-be-fine", cell=cell.name)
        yield finding("warning", "data-sheet", image, "i_disc_max", 0, _at_most(sheet.discharge_max_a, "A"), why)
    if sheet.charge_max_a is not None and -value["i_disc_min"] > sheet.charge_max_a:
        why = Message("charge-pulses-may-be-fine", cell=cell.name)
        yield finding("warning", "data-sheet", image, "i_disc_min", 0, _at_least(-sheet.charge_max_a, "A"), why)
    if abs(CONFIG["i_offset"].unpack(image)[0] - ADC_MIDDLE) > OFFSET_TOLERANCE * ADC_MIDDLE:
        low, high = (f"{ADC_MIDDLE * (1 + sign * OFFSET_TOLERANCE) / 10:.0f}" for sign in (-1, 1))
        why = Message("sensor-rests-in-middle")
        yield finding("warning", "offset", image, "i_offset", 0, Message("counts", low=low, high=high), why)


def _fans_and_line(image: bytes) -> Iterator[ConfigIssue]:
    value = _Values(image)
    if value["fan_ramp_stop"] > value["t_cell_max"]:
        limit = Message("at-most-field", field="t_cell_max", value=Quantity(value["t_cell_max"], "degC"))
        why = Message("fans-too-late")
        yield finding("warning", "fans", image, "fan_ramp_stop", 0, limit, why)
    frame_s = data_frame_time_s(FAST_WINDOWS)
    if value["telemetry_period"] < frame_s * 1000:
        why = Message("frame-takes-so-long")
        yield finding("warning", "line", image, "telemetry_period", 0, _at_least(math.ceil(frame_s * 1000), "ms"), why)


def _refused(image: bytes, error: FieldError) -> ConfigIssue:
    limit: Text = _LIMITS_OF_MASTER.get(error.field, error.limit)
    for name, other, is_strict, why in ORDERED:
        if (error.field, error.why) == (name, why):
            value = Quantity(_Values(image)[other], CONFIG[other].unit)
            limit = (
                Message("below-field", field=other, value=value)
                if is_strict
                else Message("at-most-field", field=other, value=value)
            )
    return ConfigIssue("error", "range", error, limit, _WHY_OF_MASTER.get(error.why, error.why))


def _at_most(value: float, unit: str) -> Message:
    return Message("at-most", value=Quantity(value, unit))


def _at_least(value: float, unit: str) -> Message:
    return Message("at-least", value=Quantity(value, unit))


def _below(current_a: float) -> Message:
    return Message("below", value=Quantity(current_a, "A", 1))


BIT_MASK = "mask"  # each bit is allowed or not: no range

# A field's range in the memory map is what the master's integer takes: a temperature limit up to 100 degC. What may be
# written is less: the data sheet, the regulations and the other fields bound it.
Range = tuple[int, int]
Error = tuple[str, str, int | None]  # code, field, element


def allowed_ranges(image: bytes, context: Context) -> dict[str, Range]:
    """Return the lowest and highest raw count of each field of one number that would be written without an error.

    A bit mask has no range. A field is left out where neither its value nor its default is allowed with the others.

    Raises:
        DecodeError: the image is not 420 bytes long.
    """
    return dict(_ranges(image, Context(context.cell)))  # measured periods bound tables alone


@lru_cache(maxsize=8)
def _ranges(image: bytes, context: Context) -> tuple[tuple[str, Range], ...]:
    standing = _errors(image, context)
    ranges = []
    for field in CONFIG_FIELDS:
        if field.count != 1 or field.unit == BIT_MASK or field.minimum is None or field.maximum is None:
            continue
        # an error that existed before blocks only by the field's own part
        others = frozenset(error for error in standing if error[1] != field.name)

        def is_allowed(raw: int, field: Field = field, others: frozenset[Error] = others) -> bool:
            return _errors(with_raw(image, field.name, raw), context) <= others

        numbers = (raw for raw in (field.unpack(image)[0], field.default) if isinstance(raw, int))
        inside = next(filter(is_allowed, numbers), None)
        if inside is not None:
            low, high = (_last_allowed(inside, end, is_allowed) for end in (field.minimum, field.maximum))
            ranges.append((field.name, (low, high)))
    return tuple(ranges)


def _errors(image: bytes, context: Context) -> frozenset[Error]:
    return frozenset(
        (issue.code, issue.error.field, issue.error.element) for issue in review(image, context) if issue.blocks
    )


def _last_allowed(inside: int, end: int, is_allowed: Callable[[int], bool]) -> int:
    """Return the allowed count nearest to `end`, by bisection: what is allowed has no holes."""
    if is_allowed(end):
        return end
    outside = end
    while abs(outside - inside) > 1:
        middle = (inside + outside) // 2
        if is_allowed(middle):
            inside = middle
        else:
            outside = middle
    return inside
