"""The frames that one message takes turns with, so that every cell is told once a round: `channel` backwards."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from app.sources.dbc.definitions import MessageDefinition, Signal
from app.sources.dbc.encoding.packing import bounds
from app.sources.dbc.lanes import Lane, channel

Slot = tuple[Lane, int]  # a lane and the channel that it tells in a frame
Numbers = dict[str, int]  # raw numbers by signal: multiplexers, numbers of cells


@dataclass(frozen=True, slots=True)
class Turn:
    """One frame of a message."""

    numbers: Numbers
    slots: tuple[Slot, ...]


def turns_of(message: MessageDefinition, lanes: Sequence[Lane], segments: dict[str, tuple[int, ...]]) -> list[Turn]:
    """Return the frames in which a message tells all its channels, each once where its numbers allow.

    Args:
        message: its definition.
        lanes: those of the message.
        segments: channels of each segment, by kind.
    """
    groups = [_Group(entries) for entries in _grouped(message, lanes, segments)]
    turns: list[Turn] = []
    sent: set[tuple[str, int]] = set()
    while True:
        numbers: Numbers = {}
        slots: list[Slot] = []
        before = len(sent)
        for group in sorted(groups, key=lambda each: not each.has_news(sent)):
            found = group.choose(numbers, sent)
            if found is not None:
                numbers |= found.numbers
                slots += found.slots
                sent |= {(lane.kind, index) for lane, index in found.slots}
        if len(sent) == before:
            return turns
        turns.append(Turn(numbers, tuple(slots)))


class _Group:
    """What the lanes that are chosen by the same signals tell together, by the raw numbers of those."""

    def __init__(self, entries: list[Turn]) -> None:
        self._all = entries
        self._fresh = entries

    def has_news(self, sent: set[tuple[str, int]]) -> bool:
        self._fresh = [each for each in self._fresh if _news(each, sent)]
        return bool(self._fresh)

    def choose(self, numbers: Numbers, sent: set[tuple[str, int]]) -> Turn | None:
        """The entry that fits numbers already chosen: all new if there is one, else partly, else one told before."""
        best = None
        for each in self._fresh:
            news = _news(each, sent) if _fits(each, numbers) else 0
            if news == len(each.slots):
                return each
            if news and best is None:
                best = each
        return best or next((each for each in self._all if _fits(each, numbers)), None)


def _news(entry: Turn, sent: set[tuple[str, int]]) -> int:
    return sum((lane.kind, index) not in sent for lane, index in entry.slots)


def _fits(entry: Turn, numbers: Numbers) -> bool:
    return all(numbers.get(name, raw) == raw for name, raw in entry.numbers.items())


def _grouped(
    message: MessageDefinition, lanes: Sequence[Lane], segments: dict[str, tuple[int, ...]]
) -> Iterator[list[Turn]]:
    groups: dict[frozenset[str], dict[tuple[tuple[str, int], ...], list[Slot]]] = {}
    for lane in lanes:
        for numbers, index in _entries(message, lane, segments):
            group = groups.setdefault(frozenset(numbers), {})
            group.setdefault(tuple(sorted(numbers.items())), []).append((lane, index))
    for group in groups.values():
        yield [Turn(dict(numbers), tuple(slots)) for numbers, slots in group.items()]


def _entries(
    message: MessageDefinition, lane: Lane, segments: dict[str, tuple[int, ...]]
) -> Iterator[tuple[Numbers, int]]:
    """Raw numbers under which a lane tells a channel."""
    if lane.table is not None:
        outer = _outer(message.signal(lane.multiplexer))
        for raw, index in enumerate(lane.table.tolist()):
            if index >= 0:
                yield {**outer, lane.multiplexer: raw}, index
        return
    fixed = {each.multiplexer: each.values[0] for each in lane.conditions}
    if not lane.numbers or lane.entry is None:
        yield fixed, lane.index
        return
    for _, signal in lane.numbers:
        fixed |= _outer(signal)
    of_kind = segments[lane.kind]
    spoken = [_spoken(lane, part, signal, of_kind) for part, signal in lane.numbers]
    rows = list(product(*spoken))
    if not rows:
        return
    columns = np.array(rows)[:, :, 0]
    parts = {part: np.full(len(rows), number) for part, number in lane.named_parts.items()}
    parts |= {part: columns[:, i] for i, (part, _) in enumerate(lane.numbers)}
    for row, index in zip(rows, channel(lane.entry, of_kind, parts).tolist(), strict=True):
        if index >= 0:
            yield {**fixed, **{s.name: raw for (_, s), (_, raw) in zip(lane.numbers, row, strict=True)}}, index


def _outer(signal: Signal | None) -> Numbers:
    return {each.multiplexer: each.values[0] for each in signal.conditions} if signal else {}


def _spoken(lane: Lane, part: str, signal: Signal, segments: tuple[int, ...]) -> list[tuple[int, int]]:
    """Numbers that a part may have, each with its raw number, as far as the signal holds them."""
    assert lane.entry is not None
    numbered = {name for name, _ in lane.numbers} | set(lane.named_parts)
    most = max(segments) if "segment" in numbered else sum(segments)
    group_cells = lane.entry.group_cells
    n = {
        "segment": len(segments),
        "group": -(-most // group_cells),
        "cell": max(group_cells, 1) if "group" in numbered else most,
    }[part]
    base = lane.entry.base.get(part, 0)
    low, high = bounds(signal.layout)
    scale, offset = signal.layout.scale, signal.layout.offset
    found = ((number, (number - offset) / scale) for number in range(base, base + n))
    return [(number, round(raw)) for number, raw in found if raw == round(raw) and low <= raw <= high]
