"""A battery's frames at their rates: readings in, what is due on the bus out. The decoder's lanes, run backwards."""

import heapq
import math
from collections.abc import Mapping

import numpy as np

from app.battery.battery import Battery
from app.battery.source import SpeaksDbc, StateSignal
from app.estimation.arrays import FloatArray
from app.sources.dbc.definitions import Definitions, MessageDefinition, Signal
from app.sources.dbc.encoding.packing import Place, bounds, raw_number
from app.sources.dbc.encoding.turns import Turn, turns_of
from app.sources.dbc.lanes import Lane, Lanes, lanes_of

PERIOD_S, PERIOD_OF_TURNS_S = 0.1, 0.02  # of messages for which the DBC has no cycle time
_SHORTEST_S, _LONGEST_S = 0.001, 60.0
_LONGEST_ROUND_S = 60.0  # a cycle time that makes a longer one is that of the round, as foxBMS 2 writes it
_MOST_BITS_PER_S = 250_000  # of those messages together: half a bus
_OVERHEAD_BITS = 67
_LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)  # bytes that a frame can have
_MOST_STATE = 256
Readings = Mapping[str, FloatArray]  # by kind as a decoder names it: (n_cells,), (n_sensors,) or (1,); NaN = missing


class MessageEncoder:
    """The frames of one message, one after the other."""

    def __init__(self, message: MessageDefinition, lanes: tuple[Lane, ...], source: SpeaksDbc, of: Lanes) -> None:
        self.message = message
        self.size = next((n for n in _LENGTHS if n >= message.length), 64)
        self.turns = turns_of(message, lanes, of.segments)
        self._source = source
        self._checksum = any(lane.entry is not None and lane.entry.checksum for lane in lanes)
        self._places: dict[str, Place] = {}

    def frame(self, k: int, readings: Readings) -> bytes | None:
        """Return the k-th frame of the round; None where every cell of it is missing, and nothing else is told."""
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

    def _put_value(self, whole: int, lane: Lane, value: float) -> int:
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
        place = self._places.setdefault(lane.signal, Place.of(lane.layout, self.size))
        return place.put(whole, raw)

    def _states(self, turn: Turn, readings: Readings) -> list[tuple[Signal, int]]:
        """Of each signal of states the raw number that says them best; several states may share one."""
        wanted: dict[str, dict[str, bool]] = {}
        for lane, _ in turn.slots:
            name = lane.kind.removeprefix("state.")
            if name != lane.kind:
                wanted.setdefault(lane.signal, {})[name] = bool(readings.get(lane.kind, np.zeros(1))[0] == 1.0)
        found = []
        for name, states in wanted.items():
            signal = self._signal(name)
            low, high = bounds(signal.layout)
            state_signals = {state: self._source.states[state] for state in states}
            known = (n for each in state_signals.values() for n in (*each.equals, each.mask))
            masks = 0
            for state, each in state_signals.items():
                masks |= each.mask if states[state] else 0
            choices = [n for n in (*range(_MOST_STATE), *known, masks) if low <= n <= high]
            found.append((signal, max(choices, key=lambda raw: _agreeing(raw, state_signals, states))))
        return found

    def _signal(self, name: str) -> Signal:
        signal = self.message.signal(name)
        if signal is None:
            raise KeyError(f"{self.message.name}.{name}")
        return signal

    def _put(self, whole: int, signal: Signal, raw: int) -> int:
        return self._places.setdefault(signal.name, Place.of(signal.layout, self.size)).put(whole, raw)

    def _with_checksum(self, data: bytes) -> bytes:
        total = (self.message.can_id & 0x7FF) + len(data) + sum(data[:-1])
        return data[:-1] + bytes([total & 0xFF])


def _agreeing(raw: int, state_signals: Mapping[str, StateSignal], states: Mapping[str, bool]) -> int:
    """How many states a raw number tells rightly; one that holds counts more than one that does not."""
    total = 0
    for name, signal in state_signals.items():
        is_told = bool(raw & signal.mask) if signal.mask else raw in signal.equals
        total += (2 if states[name] else 1) * (is_told == states[name])
    return total


class Speech:
    """All messages of a battery on one bus. Called from one thread; time comes from outside."""

    def __init__(self, battery: Battery, source: SpeaksDbc, definitions: Definitions) -> None:
        self.lanes = lanes_of(battery, source, definitions)
        encoders = [
            MessageEncoder(self.lanes.messages[can_id], lanes, source, self.lanes)
            for can_id, lanes in sorted(self.lanes.by_id.items())
        ]
        self._encoders = [each for each in encoders if each.turns]
        self._periods_s = _periods_s(self._encoders)
        self._due: list[tuple[float, int, int]] = []  # a heap: when, which message, how many before
        self.begin(0.0)

    @property
    def has_fd_frames(self) -> bool:
        """Some frame is longer than classic CAN carries."""
        return any(each.size > 8 for each in self._encoders)

    @property
    def due_s(self) -> float:
        """When the next frame is due [s]."""
        return self._due[0][0] if self._due else math.inf

    def unsaid(self) -> dict[str, list[int]]:
        """Return the channels that no frame tells, by kind."""
        sent = {(lane.kind, i) for each in self._encoders for turn in each.turns for lane, i in turn.slots}
        of = {kind: [i for i in range(n) if (kind, i) not in sent] for kind, n in self.lanes.sizes.items()}
        return {kind: channels for kind, channels in of.items() if channels}

    def begin(self, now_s: float) -> None:
        """Start all rounds anew, the messages spread over their periods."""
        n = max(len(self._encoders), 1)
        self._due = [(now_s + period_s * k / n, k, 0) for k, period_s in enumerate(self._periods_s)]
        heapq.heapify(self._due)

    def frames(self, now_s: float, readings: Readings) -> list[tuple[int, bytes]]:
        """Return the frames that are due, id (bit 31: 29-bit) and data."""
        found = []
        while self._due and self._due[0][0] <= now_s:
            due_s, k, n = self._due[0]
            heapq.heapreplace(self._due, (due_s + self._periods_s[k], k, n + 1))
            data = self._encoders[k].frame(n, readings)
            if data is not None:
                found.append((self._encoders[k].message.can_id, data))
        return found


def _periods_s(encoders: list[MessageEncoder]) -> list[float]:
    """Between two frames of each message: the DBC's cycle time, else a usual one, longer where a bus has no room."""
    named_s = [_named_s(each) for each in encoders]
    usual_s = [PERIOD_S if len(each.turns) == 1 else PERIOD_OF_TURNS_S for each in encoders]
    bits_per_s = sum(
        (8 * each.size + _OVERHEAD_BITS) / period_s
        for each, period_s, named in zip(encoders, usual_s, named_s, strict=True)
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
