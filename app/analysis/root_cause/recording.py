"""A stretch of a session as arrays: the only thing that hypotheses read. No file, no clock."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from app.analysis.incidents import Trigger
from app.estimation.arrays import FloatArray
from app.estimation.health.stretch import Stretch
from app.words import Message, Pack

IntArray = NDArray[np.int64]
UNKNOWN = -1  # value of a byte that was not received


@dataclass(frozen=True)
class Boards:
    """Reports of the slave boards, (m,) times [s] and a row each; a board that reported nothing has no row."""

    time_s: FloatArray
    status: FloatArray  # (m, packs)
    damaged: FloatArray  # (m, packs) packets in the last second that arrived damaged
    failed_tests: FloatArray  # (m, packs) bits of the self-tests that failed
    own_degc: FloatArray  # (m, packs) temperature of the chip


@dataclass(frozen=True)
class LineTraffic:
    """RS232: arrival of good frames and of damaged ones [s]; the length of the damaged ones against a good one's."""

    good_s: FloatArray
    bad_s: FloatArray
    bad_length: FloatArray


@dataclass(frozen=True)
class BusTraffic:
    """CAN: arrivals [s] by identifier (bit 31: 29 bits); what the master sends by its tables, with the period [s]."""

    times_s: Mapping[int, FloatArray]
    master_period_s: Mapping[int, float]
    charger_id: int | None
    shares: FloatArray = field(default_factory=lambda: np.empty(0))


@dataclass(frozen=True, kw_only=True)
class SessionStretch(Stretch):
    """A stretch of a session; NaN and UNKNOWN = not measured.

    Attributes:
        flags: (n,) the master's status bits by `bit`.
        charger_state, charger_flags: (n,) as the master has them.
        fan_duty: (n,) 0..1.
        events: everything that was reported in the stretch, in order, at unix times.
        limits: of the configuration then, by name; empty where it was not received.
    """

    flags: IntArray
    charger_state: IntArray
    charger_flags: IntArray
    fan_duty: FloatArray
    boards: Boards
    line: LineTraffic
    bus: BusTraffic
    events: Sequence[Trigger]
    limits: Mapping[str, float]
    bits: Mapping[str, int]

    def bit(self, name: str) -> FloatArray:
        """(n,) 1 or 0, NaN where not received."""
        is_known = self.flags != UNKNOWN
        return np.where(is_known, self.flags >> self.bits[name] & 1, np.nan)

    def near(self, from_s: float, to_s: float) -> slice:
        """Samples between two unix times, both included."""
        low, high = np.searchsorted(self.time_s, from_s), np.searchsorted(self.time_s, to_s, side="right")
        return slice(int(low), int(high))


@dataclass(frozen=True)
class Hypothesis:
    """A hypothesis with its evidence.

    Attributes:
        code: of the hypothesis.
        at_s: since when, unix time.
        weight: log of the odds against nothing being wrong with it.
        evidence: what was seen, the strongest first.
        cell, pack: where, by index from 0; `judge` completes the pack of a cell.
        size, sigma: how much of it there is, in `unit`, and its standard deviation; None: it has no size.
    """

    code: str
    at_s: float
    weight: float
    evidence: tuple[Message, ...] = ()
    cell: int | None = None
    pack: int | None = None
    size: float | None = None
    sigma: float | None = None
    unit: str = ""

    @property
    def place(self) -> tuple[int | None, int | None]:
        """Cell and pack."""
        return self.cell, self.pack


def pack_of_event(event: Trigger, segments: Sequence[int]) -> int | None:
    """Return the pack that an event is about: the one it names, as that of a lost slave, or that of its cell."""
    packs = () if isinstance(event.message, str) else event.message.args.get("packs")
    first = packs[0] if isinstance(packs, tuple) and packs else None
    return first.pack if isinstance(first, Pack) else pack_of(event.cell, segments)


def pack_of(cell: int | None, segments: Sequence[int]) -> int | None:
    """Return the pack of a cell, from 0, of a battery with packs of these sizes."""
    return None if cell is None else bisect_right([*accumulate(segments)], cell)
