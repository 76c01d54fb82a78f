"""The configuration and the memory map as JSON."""

from functools import cache
from typing import Any

from app.configuration.issue import ConfigIssue
from app.words import rendered
from firmware_protocol.config_image import Change, image_hash, limit_text, raw_value, unit_value
from firmware_protocol.memory_map import CONFIG_FIELDS, FIELDS, MAP_HASH, Field

_TYPES = {"B": "u8", "b": "i8", "H": "u16", "h": "i16", "I": "u32", "i": "i32"}


def _field_json(field: Field) -> dict[str, Any]:
    return {
        "name": field.name,
        "offset": field.offset,
        "type": _TYPES[field.fmt],
        "count": field.count,
        "shape": list(field.shape),
        "unit": field.unit,
        "scale": field.scale,
        "meaning": field.meaning,
    }


@cache
def schema_json() -> dict[str, Any]:
    """Limits and defaults are raw counts; multiplied by scale they are in the unit."""
    fields = [
        _field_json(field)
        | {
            "minimum": field.minimum,
            "maximum": field.maximum,
            "default": field.default,
            "range": limit_text(field),
            "group": field.group,
            "live": field.is_live,
        }
        for field in CONFIG_FIELDS
    ]
    return {
        "map_hash": MAP_HASH.hex(),
        "fields": fields,
        "groups": list(dict.fromkeys(field.group for field in CONFIG_FIELDS)),
        "struct": [_field_json(field) for field in FIELDS.values()],
    }


def config_json(image: bytes) -> dict[str, Any]:
    """A configuration image in units and in raw counts."""
    return {
        "hash": image_hash(image),
        "values": {field.name: unit_value(image, field.name) for field in CONFIG_FIELDS},
        "raw": {field.name: raw_value(image, field.name) for field in CONFIG_FIELDS},
    }


def change_json(change: Change) -> dict[str, Any]:
    """One element of a difference."""
    return {
        "field": change.field,
        "element": change.element,
        "from": change.before,
        "to": change.after,
        "unit": change.unit,
        "offset": change.offset,
    }


def finding_json(issue: ConfigIssue) -> dict[str, Any]:
    """One thing that the rules say."""
    error = issue.error
    return {
        "level": issue.level,
        "code": issue.code,
        "standing": issue.is_standing,
        "field": error.field,
        "element": error.element,
        "value": error.value,
        "limit": rendered(issue.limit),
        "why": rendered(issue.why),
        "message": rendered(issue.message),
    }
