"""Register groups of many slaves as packets: PEC15 made and checked for all of them at once.

A packet is four little-endian words: three of data, and the check word with its bytes as they go over the pair. PEC15
is linear, so the check word is the XOR of one table entry a word; `firmware_protocol.ltc6804` makes the tables.
"""

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.ltc6804 import GROUP_SIZE, pec15

DATA_WORDS = GROUP_SIZE // 2
PACKET_WORDS = DATA_WORDS + 1
WordArray = NDArray[np.uint16]


def _check_word(group: bytes) -> int:
    return int.from_bytes(pec15(group).to_bytes(2, "big"), "little")


_ZERO = _check_word(bytes(GROUP_SIZE))


def _word_table(position: int) -> WordArray:
    """Return what each value of the word at `position` adds to the check word."""
    effect = [
        [_check_word(bytes(at) + bytes([byte]) + bytes(GROUP_SIZE - 1 - at)) ^ _ZERO for byte in range(256)]
        for at in (2 * position, 2 * position + 1)
    ]
    low, high = np.array(effect, dtype=np.uint16)
    table: WordArray = high[:, None] ^ low[None, :]
    return table.reshape(-1)


_TABLES = tuple(_word_table(position) for position in range(DATA_WORDS))
_TABLES[0][:] ^= np.uint16(_ZERO)  # what all words zero give, once


def check_words(groups: WordArray) -> WordArray:
    """Return the check words of groups, shape (..., 3) to (...)."""
    first, second, third = _TABLES
    words: WordArray = first.take(groups[..., 0])
    words ^= second.take(groups[..., 1])
    words ^= third.take(groups[..., 2])
    return words


def to_packets(groups: WordArray) -> WordArray:
    """Return the groups with their check words, shape (..., 3) to (..., 4)."""
    packets = np.empty((*groups.shape[:-1], PACKET_WORDS), dtype="<u2")
    packets[..., :DATA_WORDS] = groups
    packets[..., DATA_WORDS] = check_words(groups)
    return packets


def is_intact(packets: WordArray) -> NDArray[np.bool_]:
    """Return which packets carry the check word of their data, shape (..., 4) to (...)."""
    return np.asarray(check_words(packets) == packets[..., DATA_WORDS])
