"""Older memory maps, by their hash: what an EEPROM, a recording or a profile of them means in the present one.

Only the first map differs: its `ts` was the time between two telemetry frames, which is `telemetry_period` now, and
its `dod` counted mA s. The first two bytes of an image do not show which map they are of; the bytes of
`telemetry_period` do: they were padding, always 0, and 0 is no period.
"""

from collections.abc import Mapping
from dataclasses import replace

from firmware_protocol.config_image import default_image
from firmware_protocol.memory_map import CONFIG, CONFIG_SIZE, FIELDS, MAP_HASH, Field

FIRST_MAP = "3b6bf984ad19a456"
FIRST_LAYOUT = 1  # layout version of the EEPROM
_TS, _PERIOD = CONFIG["ts"], CONFIG["telemetry_period"]
_FIRST_FIELDS: Mapping[str, Field] = {
    name: field for name, field in FIELDS.items() if name != "conf.telemetry_period"
} | {
    "conf.ts": replace(FIELDS["conf.ts"], unit="ms", minimum=20, maximum=10000, meaning=_PERIOD.meaning, is_live=True),
    "dod": replace(FIELDS["dod"], scale=1 / 3.6e6),
}
_BY_HASH: Mapping[str, Mapping[str, Field]] = {MAP_HASH.hex(): FIELDS, FIRST_MAP: _FIRST_FIELDS}


def fields_of(map_hash: str | None) -> Mapping[str, Field]:
    """Return the fields of the map with this hash (hex); the present ones where nobody knows it."""
    return _BY_HASH.get(map_hash or "", FIELDS)


def is_known(map_hash: str) -> bool:
    """True where `fields_of` knows this map."""
    return map_hash in _BY_HASH


def is_first_image(image: bytes | bytearray | memoryview) -> bool:
    """True where a configuration's bytes are of the first map."""
    return len(image) == CONFIG_SIZE and not any(image[_PERIOD.offset : _PERIOD.end])


def present_image(image: bytes | bytearray | memoryview) -> bytes:
    """Return a configuration in the present map: of the first, `ts` becomes the telemetry period, and `ts` its default.

    Anything else comes back as it is, also where it has another length.
    """
    if not is_first_image(image):
        return bytes(image)
    out = bytearray(image)
    _PERIOD.pack_into(out, _TS.unpack(image))
    out[_TS.offset : _TS.end] = default_image()[_TS.offset : _TS.end]
    return bytes(out)


def first_image(image: bytes | bytearray | memoryview) -> bytes:
    """Return what `present_image` made the image of; anything else comes back as it is."""
    out = bytearray(image)
    if len(image) == CONFIG_SIZE and not is_first_image(image):
        _TS.pack_into(out, _PERIOD.unpack(image))
        out[_PERIOD.offset : _PERIOD.end] = bytes(_PERIOD.end - _PERIOD.offset)
    return bytes(out) if present_image(out) == image else bytes(image)
