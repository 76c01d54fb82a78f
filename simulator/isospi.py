"""Register groups of many slaves over the pair: as packets with PEC15, made and disturbed all at once.

A packet is four little-endian words: three of data, and the check word with its bytes as they go over the pair. PEC15
is linear, so the check word is the XOR of one table entry a word; `firmware_protocol.ltc6804` makes the tables.
"""

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.ltc6804 import GROUP_SIZE, pec15

DATA_WORDS = GROUP_SIZE // 2
PACKET_WORDS = DATA_WORDS + 1
_COMMAND_BYTES = 4
WordArray = NDArray[np.uint16]
BoolArray = NDArray[np.bool_]


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


def flip_bits(packets: WordArray | NDArray[np.uint8], rate: float, rng: np.random.Generator) -> None:
    """Disturb packets in place: each bit flips at this rate, at most one a byte."""
    flat = packets.view(np.uint8).reshape(-1)
    hits = np.flatnonzero(rng.random(flat.size) < 8 * rate)
    flat[hits] ^= np.left_shift(1, rng.integers(0, 8, hits.size)).astype(np.uint8)


def damaged(packet: bytes, rate: float, rng: np.random.Generator) -> bytes:
    """Return what arrives of one packet."""
    arrived = np.frombuffer(packet, dtype=np.uint8).copy()
    flip_bits(arrived, rate, rng)
    return arrived.tobytes()


def carry(registers: WordArray, silent: BoolArray | None, bit_error_rate: float, rng: np.random.Generator) -> WordArray:
    """Return what arrives of all slaves' registers: (n_slaves, groups, 4), packets with their check words.

    Each group is asked for by a command of its own; a slave that gets it damaged does not answer. On a quiet pair the
    packets are not made: then it returns (n_slaves, groups, 3), the registers themselves, not to be written.

    Args:
        registers: (n_slaves, words), a multiple of three words.
        silent: (n_slaves,) whose line stays idle, None where all answer.
        bit_error_rate: share of bits that flip on the way.
        rng: what decides which.
    """
    groups = registers.reshape(len(registers), -1, DATA_WORDS)
    if silent is None and not bit_error_rate:
        return groups
    packets = to_packets(groups)
    if bit_error_rate:
        flip_bits(packets, bit_error_rate, rng)
        unheard = rng.random(groups.shape[:2]) > (1 - 8 * bit_error_rate) ** _COMMAND_BYTES
        packets[unheard] = 0xFFFF
    if silent is not None:
        packets[silent] = 0xFFFF
    return packets
