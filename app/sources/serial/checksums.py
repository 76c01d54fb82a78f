"""Checksums of serial frames: sums by their name, CRCs by the name that crccheck has for them."""

import re
from collections.abc import Callable
from functools import cache

from crccheck import crc
from crccheck.checksum import ChecksumXor8

from app.battery.serial import Checksum

SUMS: dict[str, tuple[int, Callable[[bytes], int]]] = {  # bytes, and the number
    "sum8": (1, lambda data: sum(data) & 0xFF),
    "xor8": (1, ChecksumXor8.calc),
    "sum16": (2, lambda data: sum(data) & 0xFFFF),
    "sum16-complement": (2, lambda data: -sum(data) & 0xFFFF),
}

_CRCS = {name.lower(): value for name, value in vars(crc).items() if name.startswith("Crc") and name != "CrcBase"}


@cache
def checksum_of(kind: str) -> tuple[int, Callable[[bytes], int]] | None:
    """Return the size [bytes] and the function of a checksum, None where there is none of this name."""
    if kind in SUMS:
        return SUMS[kind]
    algorithm = _CRCS.get(re.sub(r"[^a-z0-9]", "", kind.lower()))
    return None if algorithm is None else ((algorithm.width() + 7) // 8, algorithm.calc)


def is_sound(checksum: Checksum, frame: bytes) -> bool:
    """Return whether a whole frame has its checksum.

    Raises:
        KeyError: there is no checksum of this kind.
    """
    size, number = _of_kind(checksum.kind)
    at = checksum.at % len(frame)
    stored = frame[at : at + size]
    return len(stored) == size and int.from_bytes(stored, checksum.byte_order) == number(
        frame[checksum.first : checksum.end]
    )


def is_sound_line(checksum: Checksum, line: bytes) -> bool:
    """Return whether a line of text has its checksum, in hex digits.

    Raises:
        KeyError: there is no checksum of this kind.
    """
    size, number = _of_kind(checksum.kind)
    at = checksum.at % max(len(line), 1)
    try:
        stored = bytes.fromhex(line[at : at + 2 * size].decode("ascii"))
    except ValueError:
        return False
    calculated = number(line[checksum.first : checksum.end])
    return len(stored) == size and int.from_bytes(stored, checksum.byte_order) == calculated


def _of_kind(kind: str) -> tuple[int, Callable[[bytes], int]]:
    algorithm = checksum_of(kind)
    if algorithm is None:
        raise KeyError(kind)
    return algorithm
