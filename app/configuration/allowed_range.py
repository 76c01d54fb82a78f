"""The values that a field may take while all others stay as they are, by the rules themselves.

The range of a field in the memory map is what the master's integer takes: a temperature limit up to 100 degC. What may
be written is less: the data sheet, the regulations and the other fields bound it.
"""

from collections.abc import Callable
from functools import lru_cache

from app.configuration.rules import Context, review
from firmware_protocol.config_image import with_raw
from firmware_protocol.memory_map import CONFIG_FIELDS, Field

BIT_MASK = "mask"  # each bit is allowed or not: no range

Range = tuple[int, int]
Error = tuple[str, str, int | None]  # code, field, element


def allowed_ranges(image: bytes, context: Context) -> dict[str, Range]:
    """Return the lowest and highest raw count of each field of one number that would be written without an error.

    A bit mask has no range. A field is left out where neither its value nor its default is allowed beside the others.

    Raises:
        DecodeError: the image is not 420 bytes long.
    """
    return dict(_ranges(image, Context(context.cell)))  # measured periods bound tables alone


@lru_cache(maxsize=8)
def _ranges(image: bytes, context: Context) -> tuple[tuple[str, Range], ...]:
    standing = _errors(image, context)
    found = []
    for field in CONFIG_FIELDS:
        if field.count != 1 or field.unit == BIT_MASK or field.minimum is None or field.maximum is None:
            continue
        # of an error that stands already only the field's own counts
        others = frozenset(error for error in standing if error[1] != field.name)

        def is_allowed(raw: int, field: Field = field, others: frozenset[Error] = others) -> bool:
            return _errors(with_raw(image, field.name, raw), context) <= others

        known = (raw for raw in (field.unpack(image)[0], field.default) if isinstance(raw, int))
        inside = next(filter(is_allowed, known), None)
        if inside is not None:
            low, high = (_last_allowed(inside, end, is_allowed) for end in (field.minimum, field.maximum))
            found.append((field.name, (low, high)))
    return tuple(found)


def _errors(image: bytes, context: Context) -> frozenset[Error]:
    return frozenset(
        (found.code, found.error.field, found.error.element) for found in review(image, context) if found.blocks
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
