"""A battery's frames at their rates: readings in, what is due on the bus out. The decoder's lanes, run backwards."""

import heapq
import math
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from app.battery.battery import Battery
from app.battery.source import DbcMapping, StateSignal
from app.estimation.arrays import FloatArray
from app.sources.dbc.bindings import SignalBinding, SignalBindings, bind_signals, channel
from app.sources.dbc.definitions import BitLayout, Definitions, MessageDefinition, SignalDefinition

Slot = tuple[SignalBinding, int]  # a lane and the channel that it tells in a frame
Numbers = dict[str, int]  # raw numbers by signal: multiplexers, numbers of cells


@dataclass(frozen=True, slots=True)
class Turn:
    """One frame of a message."""

    numbers: Numbers
    slots: tuple[Slot, ...]


def turns_of(
    message: MessageDefinition, lanes: Sequence[SignalBinding], segments: dict[str, tuple[int, ...]]
) -> list[Turn]:
    """Return the frames in which a message tells all its channels, each once where its numbers allow.

    Args:
        message: its definition.
        lanes: those of the message.
        segments: channels of each pack, by kind.
    """
    groups = [_Group(entries) for entries in _grouped(message, lanes, segments)]
    turns: list[Turn] = []
    sent: set[tuple[str, int]] = set()
    while True:
        numbers: Numbers = {}
        slots: list[Slot] = []
        before = len(sent)
        for group in sorted(groups, key=lambda group: not group.has_news(sent)):
            turn = group.choose(numbers, sent)
            if turn is not None:
                numbers |= turn.numbers
                slots += turn.slots
                sent |= {(lane.kind, index) for lane, index in turn.slots}
        if len(sent) == before:
            return turns
        turns.append(Turn(numbers, tuple(slots)))


class _Group:
    """What the lanes that are chosen by the same signals tell together, by the raw numbers of those."""

    def __init__(self, entries: list[Turn]) -> None:
        self._all = entries
        self._fresh = entries

    def has_news(self, sent: set[tuple[str, int]]) -> bool:
        self._fresh = [entry for entry in self._fresh if _news(entry, sent)]
        return bool(self._fresh)

    def choose(self, numbers: Numbers, sent: set[tuple[str, int]]) -> Turn | None:
        """The entry that fits numbers already chosen: all new if there is one, else partly, else one sent before."""
        best = None
        for entry in self._fresh:
            news = _news(entry, sent) if _fits(entry, numbers) else 0
            if news == len(entry.slots):
                return entry
            if news and best is None:
                best = entry
        return best or next((entry for entry in self._all if _fits(entry, numbers)), None)


def _news(entry: Turn, sent: set[tuple[str, int]]) -> int:
    return sum((lane.kind, index) not in sent for lane, index in entry.slots)


def _fits(entry: Turn, numbers: Numbers) -> bool:
    return all(numbers.get(name, raw) == raw for name, raw in entry.numbers.items())


def _grouped(
    message: MessageDefinition, lanes: Sequence[SignalBinding], segments: dict[str, tuple[int, ...]]
) -> Iterator[list[Turn]]:
    groups: dict[frozenset[str], dict[tuple[tuple[str, int], ...], list[Slot]]] = {}
    for lane in lanes:
        for numbers, index in _entries(message, lane, segments):
            group = groups.setdefault(frozenset(numbers), {})
            group.setdefault(tuple(sorted(numbers.items())), []).append((lane, index))
    for group in groups.values():
        yield [Turn(dict(numbers), tuple(slots)) for numbers, slots in group.items()]


def _entries(
    message: MessageDefinition, lane: SignalBinding, segments: dict[str, tuple[int, ...]]
) -> Iterator[tuple[Numbers, int]]:
    """Raw numbers under which a lane tells a channel."""
    if lane.table is not None:
        outer = _outer(message.signal(lane.multiplexer))
        for raw, index in enumerate(lane.table.tolist()):
            if index >= 0:
                yield {**outer, lane.multiplexer: raw}, index
        return
    fixed = {condition.multiplexer: condition.values[0] for condition in lane.conditions}
    if not lane.numbers or lane.entry is None:
        yield fixed, lane.index
        return
    for _, signal in lane.numbers:
        fixed |= _outer(signal)
    of_kind = segments[lane.kind]
    spoken = [_encodable(lane, part, signal, of_kind) for part, signal in lane.numbers]
    rows = list(product(*spoken))
    if not rows:
        return
    columns = np.array(rows)[:, :, 0]
    parts = {part: np.full(len(rows), number) for part, number in lane.named_parts.items()}
    parts |= {part: columns[:, i] for i, (part, _) in enumerate(lane.numbers)}
    for row, index in zip(rows, channel(lane.entry, of_kind, parts).tolist(), strict=True):
        if index >= 0:
            yield {**fixed, **{s.name: raw for (_, s), (_, raw) in zip(lane.numbers, row, strict=True)}}, index


def _outer(signal: SignalDefinition | None) -> Numbers:
    return {condition.multiplexer: condition.values[0] for condition in signal.conditions} if signal else {}


def _encodable(
    lane: SignalBinding, part: str, signal: SignalDefinition, segments: tuple[int, ...]
) -> list[tuple[int, int]]:
    """Numbers that a part may have, each with its raw number, as far as the signal holds them."""
    assert lane.entry is not None
    numbered = {name for name, _ in lane.numbers} | set(lane.named_parts)
    most = max(segments) if "pack" in numbered else sum(segments)
    group_cells = lane.entry.group_cells
    n = {
        "pack": len(segments),
        "group": -(-most // group_cells),
        "cell": max(group_cells, 1) if "group" in numbered else most,
    }[part]
    base = lane.entry.base.get(part, 0)
    low, high = bounds(signal.layout)
    scale, offset = signal.layout.scale, signal.layout.offset
    pairs = ((number, (number - offset) / scale) for number in range(base, base + n))
    return [(number, round(raw)) for number, raw in pairs if raw == round(raw) and low <= raw <= high]


_FLOATS = {16: ("<e", "<H"), 32: ("<f", "<I"), 64: ("<d", "<Q")}


def raw_number(value: float, layout: BitLayout) -> int:
    """Return the raw number nearest to a value, within what the bits hold; a float's are its bits."""
    scaled = (value - layout.offset) / layout.scale
    if layout.is_float:
        number, bits = _FLOATS[layout.length]
        return int(struct.unpack(bits, struct.pack(number, scaled))[0])
    low, high = bounds(layout)
    return min(max(round(scaled), low), high)


def bounds(layout: BitLayout) -> tuple[int, int]:
    """Return the lowest and the highest raw number."""
    if layout.is_signed:
        return -(1 << (layout.length - 1)), (1 << (layout.length - 1)) - 1
    return 0, (1 << layout.length) - 1


@dataclass(frozen=True, slots=True)
class BitField:
    """Position of a signal in a frame of a size, the frame taken as one little-endian number."""

    size: int  # bytes
    layout: BitLayout
    mask: int

    @classmethod
    def of(cls, layout: BitLayout, size: int) -> "BitField":
        """Return the place; a signal that stands beyond the frame has none of its bits in it."""
        return cls(size, layout, cls(size, layout, 0)._shifted((1 << layout.length) - 1))

    def put(self, whole: int, raw: int) -> int:
        """Return the frame with the raw number in it."""
        return whole & ~self.mask | self._shifted(raw & ((1 << self.layout.length) - 1))

    def _shifted(self, bits: int) -> int:
        everything = (1 << 8 * self.size) - 1
        if self.layout.is_little_endian:
            return bits << self.layout.start & everything
        first = self.layout.start // 8 * 8 + 7 - self.layout.start % 8  # from the first bit on the wire
        shift = 8 * self.size - first - self.layout.length
        big = bits << shift if shift >= 0 else bits >> -shift
        return int.from_bytes((big & everything).to_bytes(self.size, "big"), "little")


PERIOD_S, PERIOD_OF_TURNS_S = 0.1, 0.02  # periods of messages without a cycle time in the DBC [s]
_SHORTEST_S, _LONGEST_S = 0.001, 60.0
_LONGEST_ROUND_S = 60.0  # a cycle time that makes a longer one is that of the round, as foxBMS 2 writes it
_MOST_BITS_PER_S = 250_000  # bits of those messages together: half a bus
_OVERHEAD_BITS = 67
_LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)  # bytes that a frame can have
_MOST_STATE = 256
Readings = Mapping[str, FloatArray]  # by kind as a decoder names it: (n_cells,), (n_sensors,) or (1,); NaN = missing


class MessageEncoder:
    """The frames of one message, one after the other."""

    def __init__(
        self, message: MessageDefinition, lanes: tuple[SignalBinding, ...], source: DbcMapping, of: SignalBindings
    ) -> None:
        self.message = message
        self.size = next((n for n in _LENGTHS if n >= message.length), 64)
        self.turns = turns_of(message, lanes, of.segments)
        self._source = source
        self._checksum = any(lane.entry is not None and lane.entry.checksum for lane in lanes)
        self._places: dict[str, BitField] = {}

    def frame(self, k: int, readings: Readings) -> bytes | None:
        """Return the k-th frame of the round; None where every cell of it is missing, and it carries nothing else."""
        turn = self.turns[k % len(self.turns)]
        values = [
            float(readings[lane.kind][index]) if lane.kind in readings else math.nan for lane, index in turn.slots
        ]
        if all(map(math.isnan, values)) and not any(lane.kind.startswith("state.") for lane, _ in turn.slots):
            return None
        whole = 0
        for name, raw in turn.numbers.items():
            whole = self._put(whole, self._signal(name), raw)
        for (lane, _), value in zip(turn.slots, values, strict=True):
            if not lane.kind.startswith("state."):
                whole = self._put_value(whole, lane, value)
        for signal, raw in self._states(turn, readings):
            whole = self._put(whole, signal, raw)
        data = whole.to_bytes(self.size, "little")
        return self._with_checksum(data) if self._checksum else data

    def _put_value(self, whole: int, lane: SignalBinding, value: float) -> int:
        """Put one value; a missing one as the battery says so: by its flag, its code, a value out of range, else 0."""
        entry, is_known = lane.entry, not math.isnan(value)
        if lane.flag is not None:
            whole = self._put(whole, lane.flag, int(is_known == lane.flag_when_valid))
        raw = raw_number(value, lane.layout) if is_known else 0
        if entry is not None and not is_known:
            if entry.invalid:
                raw = entry.invalid[0]
            elif entry.valid_range is not None:
                raw = raw_number(entry.valid_range[1] + abs(lane.layout.scale), lane.layout)
        elif entry is not None and raw in entry.invalid:
            raw += -1 if raw == bounds(lane.layout)[1] else 1
        place = self._places.setdefault(lane.signal, BitField.of(lane.layout, self.size))
        return place.put(whole, raw)

    def _states(self, turn: Turn, readings: Readings) -> list[tuple[SignalDefinition, int]]:
        """Of each signal of states the raw number that says them best; several states may share one."""
        wanted: dict[str, dict[str, bool]] = {}
        for lane, _ in turn.slots:
            name = lane.kind.removeprefix("state.")
            if name != lane.kind:
                wanted.setdefault(lane.signal, {})[name] = bool(readings.get(lane.kind, np.zeros(1))[0] == 1.0)
        entries = []
        for name, states in wanted.items():
            signal = self._signal(name)
            low, high = bounds(signal.layout)
            state_signals = {state: self._source.states[state] for state in states}
            numbers = (n for state in state_signals.values() for n in (*state.equals, state.mask))
            masks = 0
            for state, state_signal in state_signals.items():
                masks |= state_signal.mask if states[state] else 0
            choices = [n for n in (*range(_MOST_STATE), *numbers, masks) if low <= n <= high]
            entries.append((signal, max(choices, key=lambda raw: _agreeing(raw, state_signals, states))))
        return entries

    def _signal(self, name: str) -> SignalDefinition:
        signal = self.message.signal(name)
        if signal is None:
            raise KeyError(f"{self.message.name}.{name}")
        return signal

    def _put(self, whole: int, signal: SignalDefinition, raw: int) -> int:
        return self._places.setdefault(signal.name, BitField.of(signal.layout, self.size)).put(whole, raw)

    def _with_checksum(self, data: bytes) -> bytes:
        total = (self.message.can_id & 0x7FF) + len(data) + sum(data[:-1])
        return data[:-1] + bytes([total & 0xFF])


def _agreeing(raw: int, state_signals: Mapping[str, StateSignal], states: Mapping[str, bool]) -> int:
    """How many states a raw number tells rightly; one that holds counts more than one that does not."""
    total = 0
    for name, signal in state_signals.items():
        is_set = bool(raw & signal.mask) if signal.mask else raw in signal.equals
        total += (2 if states[name] else 1) * (is_set == states[name])
    return total


class FrameEncoder:
    """All messages of a battery on one bus. Called from one thread; time comes from outside."""

    def __init__(self, battery: Battery, source: DbcMapping, definitions: Definitions) -> None:
        self.lanes = bind_signals(battery, source, definitions)
        encoders = [
            MessageEncoder(self.lanes.messages[can_id], lanes, source, self.lanes)
            for can_id, lanes in sorted(self.lanes.by_id.items())
        ]
        self._encoders = [encoder for encoder in encoders if encoder.turns]
        self._periods_s = _periods_s(self._encoders)
        self._due: list[tuple[float, int, int]] = []  # a heap: when, which message, how many before
        self.begin(0.0)

    @property
    def has_fd_frames(self) -> bool:
        """Some frame is longer than classic CAN carries."""
        return any(encoder.size > 8 for encoder in self._encoders)

    @property
    def due_s(self) -> float:
        """Return when the next frame is due [s]."""
        return self._due[0][0] if self._due else math.inf

    def not_encoded(self) -> dict[str, list[int]]:
        """Return the channels that no frame tells, by kind."""
        sent = {(lane.kind, i) for encoder in self._encoders for turn in encoder.turns for lane, i in turn.slots}
        of = {kind: [i for i in range(n) if (kind, i) not in sent] for kind, n in self.lanes.sizes.items()}
        return {kind: channels for kind, channels in of.items() if channels}

    def begin(self, now_s: float) -> None:
        """Start all rounds anew, the messages spread over their periods."""
        n = max(len(self._encoders), 1)
        self._due = [(now_s + period_s * k / n, k, 0) for k, period_s in enumerate(self._periods_s)]
        heapq.heapify(self._due)

    def frames(self, now_s: float, readings: Readings) -> list[tuple[int, bytes]]:
        """Return the frames that are due, id (bit 31: 29-bit) and data."""
        frames = []
        while self._due and self._due[0][0] <= now_s:
            due_s, k, n = self._due[0]
            heapq.heapreplace(self._due, (due_s + self._periods_s[k], k, n + 1))
            data = self._encoders[k].frame(n, readings)
            if data is not None:
                frames.append((self._encoders[k].message.can_id, data))
        return frames


def _periods_s(encoders: list[MessageEncoder]) -> list[float]:
    """Between two frames of each message: the DBC's cycle time, else a usual one, longer where a bus has no room."""
    named_s = [_named_s(encoder) for encoder in encoders]
    usual_s = [PERIOD_S if len(encoder.turns) == 1 else PERIOD_OF_TURNS_S for encoder in encoders]
    bits_per_s = sum(
        (8 * encoder.size + _OVERHEAD_BITS) / period_s
        for encoder, period_s, named in zip(encoders, usual_s, named_s, strict=True)
        if named is None
    )
    longer = max(1.0, bits_per_s / _MOST_BITS_PER_S)
    return [period_s * longer if named is None else named for period_s, named in zip(usual_s, named_s, strict=True)]


def _named_s(encoder: MessageEncoder) -> float | None:
    period_s, n = encoder.message.period_s, len(encoder.turns)
    if period_s is None:
        return None
    if n > 1 and period_s * n > _LONGEST_ROUND_S:
        period_s /= n
    return min(max(period_s, _SHORTEST_S), _LONGEST_S)
