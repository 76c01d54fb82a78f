"""The CAN bus in virtual time: arbitration, frames of their length, error counters, bus-off.

Nodes queue frames and get those of others when their last bit has passed. A frame that is destroyed or not acknowledged
is sent again; who fails too often is first passive, then off the bus, and comes back after 128 idle sequences.
"""

import heapq
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

WARNING, PASSIVE, BUS_OFF = 96, 128, 256  # error counts
SENDER_STEP = 8  # sender's error count for a failed frame; a receiver's is 1
RECOVERY_BITS = 128 * 11
ERROR_FRAME_BITS = 20
MAX_WAITING = 96  # frames of a node
MAX_AGE_S = 0.2  # a frame that could not be sent for so long is given up: old is never live
_HOPELESS_S = 0.1  # between tries that cannot succeed, which on a real bus follow at once
_STANDARD_BITS, _EXTENDED_BITS = 47, 67  # without data, with the space between frames
_UNSTUFFED_BITS = 13  # bits without stuffing: end of frame, acknowledge, space
_FD_BITS, _FD_DATA_SPEED_UP = 30, 4  # bits of a CAN FD frame at the bus's rate; the rest is sent four times as fast
_FD_FAST_BITS, _CLASSIC_BYTES = 40, 8  # bits at the fast rate without data, bytes of classic CAN
_STUFFING = 0.033  # bits stuffed a bit, mean over random data
_STANDARD_SHIFT = 18


@dataclass(frozen=True, slots=True)
class CanFrame:
    """One data frame; one of more than 8 bytes is CAN FD."""

    can_id: int
    is_extended: bool
    data: bytes

    @property
    def is_fd(self) -> bool:
        """It is longer than classic CAN carries."""
        return len(self.data) > _CLASSIC_BYTES

    @property
    def priority(self) -> tuple[int, bool, int]:
        """Return the key that decides between frames that begin together: the lower wins, standard before extended."""
        return (self.can_id >> _STANDARD_SHIFT if self.is_extended else self.can_id, self.is_extended, self.can_id)

    @property
    def bits(self) -> float:
        """Length on the wire with mean stuffing, and the space after it."""
        if self.is_fd:
            return _FD_BITS + 20 * self.is_extended + (_FD_FAST_BITS + 8 * len(self.data)) / _FD_DATA_SPEED_UP
        plain = (_EXTENDED_BITS if self.is_extended else _STANDARD_BITS) + 8 * len(self.data)
        return plain + _STUFFING * (plain - _UNSTUFFED_BITS)


class CanListener(Protocol):
    """A node on the bus."""

    @property
    def bit_rate(self) -> int:
        """The bit rate that the node is set to [bit/s]; 0 while it is off the bus."""
        ...

    @property
    def is_listening_only(self) -> bool:
        """It neither acknowledges nor destroys frames."""
        ...

    def can_received(self, frame: CanFrame, now_s: float) -> None:
        """Take a frame that another node sent."""
        ...


Waiting = tuple[tuple[int, bool, int], int, float, CanFrame]  # weight, order of arrival, since when [s], frame


@dataclass(slots=True)
class Station:
    """The queue of a node and its error counters."""

    node: CanListener
    max_waiting: int = MAX_WAITING
    waiting: list[Waiting] = field(default_factory=list)  # a heap
    transmit_errors: int = 0
    receive_errors: int = 0
    off_since_s: float | None = None
    off_rate: int = 0

    @property
    def is_active(self) -> bool:
        """It destroys frames that it does not understand; a passive one cannot."""
        return self.transmit_errors < PASSIVE and self.receive_errors < PASSIVE


class CanBus:
    """The wire; `noise_per_bit` is the share of bits that are disturbed."""

    def __init__(self, rng: np.random.Generator | None = None) -> None:
        self._rng = rng or np.random.default_rng(0)
        self._stations: dict[int, Station] = {}
        self._is_broken = False
        self._now_s = 0.0
        self.noise_per_bit = 0.0
        self.frames = 0
        self.error_frames = 0
        self.error_listeners: list[Callable[[], None]] = []  # called at each error frame
        self._current: tuple[Station, Waiting] | None = None
        self.due_s = math.inf  # when something happens on the bus by itself [s]
        self._free_s = 0.0
        self._order = itertools.count()

    @property
    def is_broken(self) -> bool:
        """A short circuit destroys every frame, and no node that is bus-off recovers."""
        return self._is_broken

    @is_broken.setter
    def is_broken(self, is_broken: bool) -> None:
        for station in self._stations.values():
            if station.off_since_s is not None:
                station.off_since_s = self._now_s
        self._is_broken = is_broken

    def attach(self, node: CanListener, max_waiting: int = MAX_WAITING) -> None:
        """Connect a node; its queue holds `max_waiting` frames."""
        self._stations[id(node)] = Station(node, max_waiting)

    def detach(self, node: CanListener) -> None:
        """Disconnect a node; what it was sending is lost."""
        station = self._stations.pop(id(node), None)
        if self._current is not None and self._current[0] is station:
            self._current = None

    def station(self, node: CanListener) -> Station:
        """Return the queue and error counters of a connected node."""
        return self._stations[id(node)]

    def is_off(self, node: CanListener) -> bool:
        """Return whether a node is bus-off."""
        return self._stations[id(node)].off_since_s is not None

    def send(self, sender: CanListener, frame: CanFrame, now_s: float) -> None:
        """Queue a frame; it is sent when the bus is free and no frame of higher priority waits."""
        station = self._stations[id(sender)]
        if not sender.bit_rate or station.off_since_s is not None or len(station.waiting) >= station.max_waiting:
            return
        heapq.heappush(station.waiting, (frame.priority, next(self._order), now_s, frame))
        if self._current is None:
            self.due_s = min(self.due_s, max(now_s, self._free_s))

    def run(self, now_s: float) -> None:
        """Process everything that is due until now."""
        self._now_s = now_s
        while self.due_s <= now_s:
            at_s = self.due_s
            if self._current is not None:
                (sender, item), self._current = self._current, None
                self._free_s = self._end(sender, item, at_s)
            self._recover(at_s)
            if self._free_s > at_s:
                self.due_s = self._free_s
            else:
                self._begin(at_s)

    def _begin(self, now_s: float) -> None:
        """Start the frame of the highest priority."""
        weightiest: Station | None = None
        for station in self._stations.values():
            waiting = station.waiting
            if not station.node.bit_rate:
                waiting.clear()
            while waiting and now_s - waiting[0][2] > MAX_AGE_S:
                heapq.heappop(waiting)
            if waiting and (weightiest is None or waiting[0] < weightiest.waiting[0]):
                weightiest = station
        if weightiest is None:
            self.due_s = self._next_recovery_s()
            return
        item = heapq.heappop(weightiest.waiting)
        self._current = (weightiest, item)
        self.due_s = now_s + item[3].bits / weightiest.node.bit_rate

    def _end(self, sender: Station, item: Waiting, now_s: float) -> float:
        """Deliver a frame, or queue it again where it failed; return when the bus is free again [s]."""
        rate, frame = sender.node.bit_rate, item[3]
        if not rate:
            return now_s
        others = [
            station
            for station in self._stations.values()
            if station is not sender and station.off_since_s is None and station.node.bit_rate
        ]
        same = [station for station in others if station.node.bit_rate == rate]
        takers = [station for station in same if not station.node.is_listening_only]
        strangers = [
            station for station in others if station.node.bit_rate != rate and not station.node.is_listening_only
        ]
        if self.is_broken:
            return self._destroyed(sender, item, [], now_s)
        if any(station.is_active for station in strangers):
            return self._destroyed(sender, item, strangers, now_s)
        if not takers:
            return self._unanswered(sender, item, now_s)
        if self.noise_per_bit and self._rng.random() > (1.0 - self.noise_per_bit) ** frame.bits:
            return self._destroyed(sender, item, takers, now_s)
        sender.transmit_errors = max(sender.transmit_errors - 1, 0)
        self.frames += 1
        for station in same:
            station.receive_errors = max(station.receive_errors - 1, 0)
            station.node.can_received(frame, now_s)
        return now_s

    def _unanswered(self, sender: Station, item: Waiting, now_s: float) -> float:
        """Count a missing acknowledge; it never leads to bus-off."""
        self._broadcast_error()
        heapq.heappush(sender.waiting, item)
        if sender.transmit_errors >= PASSIVE:
            return now_s + _HOPELESS_S
        sender.transmit_errors += SENDER_STEP
        return now_s + ERROR_FRAME_BITS / sender.node.bit_rate

    def _destroyed(self, sender: Station, item: Waiting, others: list[Station], now_s: float) -> float:
        rate = sender.node.bit_rate
        self._broadcast_error()
        sender.transmit_errors += SENDER_STEP
        for station in others:
            station.receive_errors = min(station.receive_errors + 1, PASSIVE)
        if sender.transmit_errors >= BUS_OFF:
            sender.off_since_s, sender.off_rate = now_s, rate
            sender.waiting.clear()
        else:
            heapq.heappush(sender.waiting, item)
        return now_s + ERROR_FRAME_BITS / rate

    def _broadcast_error(self) -> None:
        self.error_frames += 1
        for listener in self.error_listeners:
            listener()

    def _recover(self, now_s: float) -> None:
        for station in self._stations.values():
            if station.off_since_s is None:
                continue
            if self.is_broken:
                station.off_since_s = now_s  # no recessive bits to count
            elif now_s >= _recovery_s(station):
                station.off_since_s = None
                station.transmit_errors = station.receive_errors = 0

    def _next_recovery_s(self) -> float:
        return min(
            (_recovery_s(station) for station in self._stations.values() if station.off_since_s is not None),
            default=math.inf,
        )


def _recovery_s(station: Station) -> float:
    return math.inf if station.off_since_s is None else station.off_since_s + RECOVERY_BITS / station.off_rate
