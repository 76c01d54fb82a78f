"""What speaks on a bus: each message with its rate, each signal with its range."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from app.estimation.arrays import FloatArray
from app.sources.dbc.decoder import MessageFrames, by_message
from app.sources.dbc.definitions import Definitions, MessageDefinition, Signal
from app.sources.dbc.extraction import physical_values, raw_values
from app.sources.dbc.frames import Frames

_MOST_KEPT = 200_000  # frames of one message; a survey needs no more
_MOST_DISTINCT = 4096


@dataclass(frozen=True, slots=True)
class Heard:
    """A signal's values in the order of their frames, in the unit of the DBC."""

    t_ns: NDArray[np.int64]
    values: FloatArray
    raw: NDArray[np.int64]

    @property
    def low(self) -> float:
        """The lowest value."""
        return float(np.nanmin(self.values))

    @property
    def high(self) -> float:
        """The highest value."""
        return float(np.nanmax(self.values))


@dataclass(slots=True)
class MessageHeard:
    """The frames of one message."""

    message: MessageDefinition
    group: MessageFrames
    _signals: dict[str, Heard | None] = field(default_factory=dict)

    @property
    def rate_hz(self) -> float:
        """Frames a second while the message is heard; NaN of one frame."""
        t_ns = self.group.frames.t_ns
        span_s = (int(t_ns[-1]) - int(t_ns[0])) / 1e9
        return (len(t_ns) - 1) / span_s if span_s > 0 else float("nan")

    def signal(self, name: str) -> Heard | None:
        """What was heard of a signal; None: no frame carries it."""
        if name not in self._signals:
            self._signals[name] = self._decoded(self.message.signal(name))
        return self._signals[name]

    def _decoded(self, signal: Signal | None) -> Heard | None:
        if signal is None or signal.layout.end_byte > self.group.frames.data.shape[1]:
            return None
        here = self.group.carrying(signal)
        frames = self.group.frames if here is None else self.group.frames.part(np.flatnonzero(here))
        if not len(frames):
            return None
        raw = raw_values(frames.data, signal.layout)
        return Heard(frames.t_ns, physical_values(raw, signal.layout), raw.astype(np.int64))


@dataclass(frozen=True, slots=True)
class Survey:
    """Definitions and what was heard of them."""

    definitions: Definitions
    heard: dict[int, MessageHeard]  # by id
    unknown: dict[int, int]  # frames of ids that no message has
    n_frames: int
    duration_s: float

    def of(self, message: MessageDefinition) -> MessageHeard | None:
        """What was heard of a message."""
        return self.heard.get(message.can_id)

    def signal(self, message: MessageDefinition, name: str) -> Heard | None:
        """What was heard of a signal of a message."""
        heard = self.of(message)
        return None if heard is None else heard.signal(name)


def survey(definitions: Definitions, frames: Frames) -> Survey:
    """Return what was heard, by the definitions."""
    by_id = definitions.by_id()
    heard = {
        group.message.can_id: MessageHeard(group.message, _thinned(group)) for _, group in by_message(frames, by_id)
    }
    ids, counts = np.unique(frames.can_id, return_counts=True)
    unknown = {int(i): int(n) for i, n in zip(ids, counts, strict=True) if int(i) not in by_id}
    span_s = (int(frames.t_ns.max()) - int(frames.t_ns.min())) / 1e9 if len(frames) else 0.0
    return Survey(definitions, heard, unknown, len(frames), span_s)


def _thinned(group: MessageFrames) -> MessageFrames:
    return (
        group if len(group.frames) <= _MOST_KEPT else MessageFrames(group.message, group.frames.part(slice(_MOST_KEPT)))
    )


def distinct(heard: Iterable[Heard | None]) -> NDArray[np.int64]:
    """Return the whole numbers that signals took, sorted; empty where one is not whole or they are too many."""
    found: set[int] = set()
    for each in heard:
        if each is None:
            continue
        values = np.unique(each.values)
        if len(values) > _MOST_DISTINCT or not np.array_equal(values, np.rint(values)):
            return np.empty(0, np.int64)
        found |= {int(value) for value in values}
    return np.array(sorted(found), np.int64)
