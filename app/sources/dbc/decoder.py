"""Every signal of every message, of many frames at once: the form in which `learn` and tests look at a bus."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.estimation.arrays import BoolArray, FloatArray, IntArray
from app.sources.dbc.definitions import Definitions, MessageDefinition, Signal
from app.sources.dbc.extraction import physical_values, raw_values
from app.sources.dbc.frames import Frames


@dataclass(frozen=True, slots=True)
class Series:
    """A signal's values, each with the time of its frame."""

    t_ns: NDArray[np.int64]  # (n,)
    values: FloatArray  # (n,) in the unit of the DBC


class MessageFrames:
    """The frames of one message; raw numbers are extracted once."""

    def __init__(self, message: MessageDefinition, frames: Frames) -> None:
        self.message = message
        self.frames = frames
        self._raw: dict[str, NDArray[np.int64] | NDArray[np.uint64]] = {}

    def carrying(self, signal: Signal) -> BoolArray | None:
        """(n,) which frames carry a signal; None = all: long enough, and its multiplexers say so."""
        needed = signal.layout.end_byte
        found: BoolArray | None = None
        if len(self.frames) and int(self.frames.length.min()) < needed:
            found = self.frames.length >= needed
        for condition in signal.conditions:
            raw = self.raw(condition.multiplexer)
            if len(condition.values) == 1:
                here = raw == raw.dtype.type(condition.values[0])
            else:
                here = np.isin(raw, np.array(condition.values).astype(raw.dtype))
            found = here if found is None else found & here
        return found

    def raw(self, name: str) -> NDArray[np.int64] | NDArray[np.uint64]:
        """(n,) raw numbers of a signal in every frame, whether it carries them or not."""
        if name not in self._raw:
            signal = self.message.signal(name)
            if signal is None or signal.layout.end_byte > self.frames.data.shape[1]:
                self._raw[name] = np.zeros(len(self.frames), np.uint64)
            else:
                self._raw[name] = raw_values(self.frames.data, signal.layout)
        return self._raw[name]


def by_message(frames: Frames, messages: Mapping[int, MessageDefinition]) -> Iterator[tuple[IntArray, MessageFrames]]:
    """Yield the frames of each message with their rows, in the order in which they came; unknown ids are left out."""
    if not len(frames) or not messages:
        return
    known = np.array(sorted(messages), np.uint32)
    place = np.searchsorted(known, frames.can_id)
    place[place == len(known)] = 0
    code = np.where(known[place] == frames.can_id, place, len(known)).astype(np.uint16)
    order = np.argsort(code, kind="stable")  # 16 bits: a radix sort
    bounds = np.searchsorted(code[order], np.arange(len(known) + 1))
    for i, can_id in enumerate(known.tolist()):
        rows = order[bounds[i] : bounds[i + 1]]
        if len(rows):
            yield rows, MessageFrames(messages[can_id], frames.part(rows))


def decode_frames(frames: Frames, definitions: Definitions) -> dict[tuple[str, str], Series]:
    """Return the series of each signal that was heard, by message and signal."""
    found: dict[tuple[str, str], Series] = {}
    for _, group in by_message(frames, definitions.by_id()):
        found.update(decode_message(group))
    return found


def decode_message(group: MessageFrames) -> dict[tuple[str, str], Series]:
    """Return the series of each signal of one message."""
    found = {}
    for signal in group.message.signals:
        if signal.layout.end_byte > group.frames.data.shape[1]:
            continue
        carrying = group.carrying(signal)
        frames = group.frames if carrying is None else group.frames.part(np.flatnonzero(carrying))
        if len(frames):
            values = physical_values(raw_values(frames.data, signal.layout), signal.layout)
            found[group.message.name, signal.name] = Series(frames.t_ns, values)
    return found
