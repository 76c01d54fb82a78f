"""Register groups of many slaves as packets: PEC15 made and checked for all of them at once.

PEC15 is linear, so the check word of six bytes is the XOR of six table entries; `firmware_protocol.ltc6804` is the
reference that the tables are made from.
"""

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.ltc6804 import GROUP_SIZE, PEC_SIZE, pec15

PACKET_SIZE = GROUP_SIZE + PEC_SIZE
ByteArray = NDArray[np.uint8]

_ZERO_PEC = pec15(bytes(GROUP_SIZE))


def _linear_tables() -> NDArray[np.uint16]:
    rows = [
        [pec15(bytes(position) + bytes([byte]) + bytes(GROUP_SIZE - 1 - position)) ^ _ZERO_PEC for byte in range(256)]
        for position in range(GROUP_SIZE)
    ]
    return np.array(rows, dtype=np.uint16).reshape(-1)


_TABLES = _linear_tables()
_ROW_START = np.arange(GROUP_SIZE, dtype=np.intp) * 256


def pec15_of(groups: ByteArray) -> NDArray[np.uint16]:
    """Return the check words of groups, shape (..., 6) to (...)."""
    entries = _TABLES.take(groups + _ROW_START)
    words: NDArray[np.uint16] = np.bitwise_xor.reduce(entries, axis=-1) ^ np.uint16(_ZERO_PEC)
    return words


def to_packets(groups: ByteArray) -> ByteArray:
    """Return the groups with their check words, shape (..., 6) to (..., 8)."""
    words = pec15_of(groups)
    packets = np.empty((*groups.shape[:-1], PACKET_SIZE), dtype=np.uint8)
    packets[..., :GROUP_SIZE] = groups
    packets[..., GROUP_SIZE] = words >> 8
    packets[..., GROUP_SIZE + 1] = words
    return packets


def is_intact(packets: ByteArray) -> NDArray[np.bool_]:
    """Return which packets carry the check word of their data, shape (..., 8) to (...)."""
    words = packets[..., GROUP_SIZE].astype(np.uint16) << 8 | packets[..., GROUP_SIZE + 1]
    return np.asarray(pec15_of(packets[..., :GROUP_SIZE]) == words)
