"""The configuration in the 32 kB EEPROM: two slots. Behind them the firmware keeps its journal of the charge drawn.

A slot is eight pages: a header page, then the image in seven. A page write may be cut after any byte, so a store
first wipes the older slot's header, then writes the image, then the header whose last bytes are the CRC: until that
CRC is whole the slot is invalid, and the other slot was never touched.
What a firmware of layout 1 left is read in the present map; it would not understand what is written now.
CRC-32 here is the common one (reflected 0xEDB88320, start and final XOR 0xFFFFFFFF; 0xCBF43926 over "123456789").
"""

import binascii
import struct
from dataclasses import dataclass

from firmware_protocol.config_image import Image, canonical
from firmware_protocol.errors import DecodeError, EncodeError
from firmware_protocol.memory_map import CONFIG_SIZE
from firmware_protocol.older_maps import FIRST_LAYOUT, present_image

EEPROM_SIZE = 32 * 1024
PAGE_SIZE = 64
LAYOUT_VERSION = 2  # version of the struct; any other slot is invalid

SLOT_OFFSETS = (0, 8 * PAGE_SIZE)
SLOT_SIZE = 8 * PAGE_SIZE
SLOT_MAGIC = b"VWCF"
_SLOT_HEADER = struct.Struct("<4sHHI")  # magic, length, layout version, counter
_CRC = struct.Struct("<I")

JOURNAL_OFFSET = 16 * PAGE_SIZE
JOURNAL_PAGES = EEPROM_SIZE // PAGE_SIZE - JOURNAL_OFFSET // PAGE_SIZE

_COUNTER_END = 1 << 32


@dataclass(frozen=True, slots=True)
class PageWrite:
    """Bytes for one page, in one write: they never cross the page's end."""

    offset: int
    data: bytes


@dataclass(frozen=True, slots=True)
class StoredConfig:
    """A valid slot."""

    image: bytes
    counter: int  # one more at every store; the highest is the newest
    slot: int


def crc32(data: bytes | bytearray | memoryview) -> int:
    """CRC-32/ISO-HDLC."""
    return binascii.crc32(data)


def encode_slot(image: Image, counter: int) -> bytes:
    """Return the SLOT_SIZE bytes of a slot; unused bytes are 0.

    Raises:
        DecodeError: the image is not CONFIG_SIZE bytes long.
        EncodeError: the counter is outside 1..4294967295.
    """
    if not 0 < counter < _COUNTER_END:
        raise EncodeError("counter", counter, f"1..{_COUNTER_END - 1}")
    body = canonical(image)
    header = _SLOT_HEADER.pack(SLOT_MAGIC, CONFIG_SIZE, LAYOUT_VERSION, counter)
    page = header + _CRC.pack(crc32(header + body))
    return (page.ljust(PAGE_SIZE, b"\0") + body).ljust(SLOT_SIZE, b"\0")


def decode_slot(data: Image, slot: int) -> StoredConfig | None:
    """Decode the SLOT_SIZE bytes of a slot; None where they are no valid configuration of a known layout."""
    if len(data) != SLOT_SIZE:
        return None
    magic, length, layout, counter = _SLOT_HEADER.unpack_from(data)
    if (magic, length) != (SLOT_MAGIC, CONFIG_SIZE) or layout not in (FIRST_LAYOUT, LAYOUT_VERSION) or not counter:
        return None
    image = bytes(data[PAGE_SIZE : PAGE_SIZE + CONFIG_SIZE])
    expected = crc32(bytes(data[: _SLOT_HEADER.size]) + image)
    if _CRC.unpack_from(data, _SLOT_HEADER.size)[0] != expected:
        return None
    return StoredConfig(present_image(image) if layout == FIRST_LAYOUT else image, counter, slot)


def valid_slots(eeprom: Image) -> list[StoredConfig]:
    """Return the valid slots, newest first.

    Raises:
        DecodeError: the image is too short to hold both slots.
    """
    if len(eeprom) < SLOT_OFFSETS[-1] + SLOT_SIZE:
        raise DecodeError("EEPROM", f"{len(eeprom)} bytes, at least {SLOT_OFFSETS[-1] + SLOT_SIZE}")
    slots = [
        stored
        for slot, offset in enumerate(SLOT_OFFSETS)
        if (stored := decode_slot(eeprom[offset : offset + SLOT_SIZE], slot)) is not None
    ]
    return sorted(slots, key=lambda stored: stored.counter, reverse=True)


def newest(eeprom: Image) -> StoredConfig | None:
    """Return the newest valid configuration, None where no slot holds one.

    Raises:
        DecodeError: the image is too short to hold both slots.
    """
    slots = valid_slots(eeprom)
    return slots[0] if slots else None


def plan_store(eeprom: Image, image: Image) -> list[PageWrite]:
    """Return the page writes, to be done in this order, after which `newest` gives `image`.

    Cut after any byte of any of them, `newest` gives what it gave before, or `image`. Pages of the image that the
    slot holds already are left out.

    Raises:
        DecodeError: a wrong size.
        EncodeError: the counter is used up (after 4294967295 stores).
    """
    current = newest(eeprom)
    slot = 0 if current is None else 1 - current.slot
    start = SLOT_OFFSETS[slot]
    data = encode_slot(image, 1 if current is None else current.counter + 1)
    pages = [PageWrite(start + at, data[at : at + PAGE_SIZE]) for at in range(PAGE_SIZE, SLOT_SIZE, PAGE_SIZE)]
    return [
        PageWrite(start, bytes(PAGE_SIZE)),
        *(page for page in pages if eeprom[page.offset : page.offset + PAGE_SIZE] != page.data),
        PageWrite(start, data[:PAGE_SIZE]),
    ]
