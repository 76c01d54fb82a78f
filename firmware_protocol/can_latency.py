"""Worst latencies of the master's messages on the bus.

Response-time analysis for CAN: a frame waits for the longest one of lower priority that has just begun, and for every
one of higher priority that becomes due meanwhile:

    w = B + sum over higher k of ceil((w + t_bit) / T_k) C_k,    R = w + C

Source: Davis, Burns, Bril, Lukkien, "Controller Area Network (CAN) schedulability analysis", 2007, eq. (4) to (6);
jitter is left out, frames are the longest that bit stuffing can make of them.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from firmware_protocol.can_tables import bit_rate, rx_messages, tx_messages, worst_case_bits
from firmware_protocol.config_image import Image
from firmware_protocol.memory_map import CAN_DATA_BYTES, CONFIG

MAX_ROUNDS = 1000


@dataclass(frozen=True, slots=True)
class Cyclic:
    """A message that is sent again and again, by whomever."""

    can_id: int
    is_extended: bool
    length: int
    period_s: float

    @property
    def priority(self) -> tuple[int, bool, int]:
        """Lower wins the arbitration: the 11 leading bits, then the 11-bit format, then the other 18."""
        if self.is_extended:
            return self.can_id >> 18, True, self.can_id & 0x3FFFF
        return self.can_id, False, 0


def cyclic_messages(config: Image) -> dict[int, Cyclic]:
    """Return the master's cyclic messages by index: on from the start, or activated by a message listened for."""
    activated = {rx.response for rx in rx_messages(config) if rx.enabled}
    return {
        tx.index: Cyclic(tx.can_id, tx.is_extended, tx.length, tx.period_ms / 1000)
        for tx in tx_messages(config)
        if tx.period_ms and tx.length and (tx.enabled or tx.index in activated)
    }


def worst_latencies_s(config: Image, others: Iterable[Cyclic] = ()) -> dict[int, float | None]:
    """Return how long each of the master's cyclic messages may take from being due to being sent [s].

    None where the bus is too busy for it to be sent before it is due again. `others` are messages of other nodes; one
    unknown frame of full length is assumed under way in any case.
    """
    rate = bit_rate(CONFIG["can_brp"].unpack(config)[0])
    own = cyclic_messages(config)
    priorities = {message.priority for message in own.values()}
    everyone = [*own.values(), *(other for other in others if other.period_s > 0 and other.priority not in priorities)]
    return {index: _latency_s(message, everyone, rate) for index, message in own.items()}


def _latency_s(message: Cyclic, everyone: list[Cyclic], rate: int) -> float | None:
    own_s = worst_case_bits(message.length, message.is_extended) / rate
    blocking_s = worst_case_bits(CAN_DATA_BYTES, is_extended=True) / rate
    higher = [
        (other.period_s, worst_case_bits(other.length, other.is_extended) / rate)
        for other in everyone
        if other.priority < message.priority
    ]
    waiting_s = blocking_s
    for _ in range(MAX_ROUNDS):
        longer_s = blocking_s + sum(math.ceil((waiting_s + 1 / rate) / period_s) * c_s for period_s, c_s in higher)
        if longer_s + own_s > message.period_s:
            return None
        if longer_s == waiting_s:
            return waiting_s + own_s
        waiting_s = longer_s
    return None
