"""Frames into what cells, sensors and the whole battery read, each value with the time of its frame."""

from collections import defaultdict
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.battery.battery import Battery
from app.battery.source import DbcMapping
from app.estimation.arrays import BoolArray, FloatArray, IntArray
from app.sources.dbc.aligned_bindings import AlignedBindings
from app.sources.dbc.bindings import SignalBinding, bind_signals, channel
from app.sources.dbc.decoder import MessageFrames, by_message, physical_values, raw_values
from app.sources.dbc.definitions import Definitions
from app.sources.dbc.frames import Frames

_ORION_ID = 0x7FF
ABSENT_DEGC = -40.0  # what a sensor that is not connected reads: no battery is so cold
MANY_FRAMES = 2000  # from here on, each message has many frames: lane by lane is faster


@dataclass(frozen=True, slots=True)
class ChannelValues:
    """Values of one kind in frames, in their order. A value is NaN where the battery calls it invalid."""

    t_ns: NDArray[np.int64]  # (n,) time of the frame
    index: IntArray  # (n,) cell, sensor, or 0
    value: FloatArray  # (n,) V, degC, A, ohm, a fraction of 1; 0 or 1 of a state


class BatteryDecoder:
    """Decodes the frames of one battery; holds nothing between two calls but counts."""

    def __init__(self, battery: Battery, source: DbcMapping, definitions: Definitions) -> None:
        self.battery = battery
        self.source = source
        self.lanes = bind_signals(battery, source, definitions)
        self._plain = AlignedBindings(self.lanes)
        self._remaining = {k: message for k, message in self.lanes.messages.items() if k not in set(self._plain.ids)}
        self.bad_checksums = 0
        self.absent = np.zeros(self.lanes.sizes.get("temperature", 0), np.intp)  # values of ABSENT_DEGC, by sensor
        self.beyond: dict[str, int] = defaultdict(int)  # values of numbers that no cell has, by signal

    def decode(self, frames: Frames) -> dict[str, ChannelValues]:
        """Return what the frames tell, by kind: `voltage`, `current`, `state.closed`, `limit.…`."""
        parts: dict[str, list[tuple[IntArray, IntArray, FloatArray]]] = defaultdict(list)
        messages = self.lanes.messages
        if len(frames) < MANY_FRAMES:
            messages = self._remaining
            for kind, part in self._plain.decode(frames):
                parts[kind].append(part)
        for rows, group in by_message(frames, messages):
            sound: BoolArray | None = None
            for lane in self.lanes.by_id[group.message.can_id]:
                if lane.entry is not None and lane.entry.checksum and sound is None:
                    sound = _has_orion_checksum(group)
                    self.bad_checksums += int(np.count_nonzero(~sound))
                checked = sound if lane.entry is not None and lane.entry.checksum else None
                read = self._read(lane, group, checked)
                if read is not None:
                    here, index, value = read
                    parts[lane.kind].append((rows if here is None else rows[here], index, value))
        decoded = {kind: _in_order(frames, part) for kind, part in parts.items()}
        if "temperature" in decoded:
            self._drop_absent(decoded["temperature"])
        return decoded

    def _drop_absent(self, temperature: ChannelValues) -> None:
        is_absent = temperature.value <= ABSENT_DEGC
        if is_absent.any():
            self.absent += np.bincount(temperature.index[is_absent], minlength=len(self.absent))
            temperature.value[is_absent] = np.nan

    def _read(
        self, lane: SignalBinding, group: MessageFrames, here: BoolArray | None
    ) -> tuple[IntArray | None, IntArray, FloatArray] | None:
        """Rows (None = all), channels and values of a lane."""
        data = group.frames.data
        if lane.layout.end_byte > data.shape[1]:
            return None
        signal = group.message.signal(lane.signal)
        if signal is not None and lane.table is None:
            here = _both(here, group.carrying(signal))
        elif int(group.frames.length.min()) < lane.layout.end_byte:
            here = _both(here, group.frames.length >= lane.layout.end_byte)
        index: IntArray | None = None
        if lane.table is not None:
            selected = np.minimum(group.raw(lane.multiplexer).astype(np.intp), len(lane.table) - 1)
            index = lane.table[selected]
        elif lane.numbers and lane.entry is not None:
            index = self._channels(lane, group)
        if index is not None:
            is_known = index >= 0
            if lane.numbers and not is_known.all():
                counted = is_known if here is None else is_known | ~here
                n_beyond = int(np.count_nonzero(~counted))
                if n_beyond:
                    self.beyond[f"{group.message.name}.{lane.signal}"] += n_beyond
            if lane.table is not None or not is_known.all():
                here = _both(here, is_known)
        rows = None if here is None or here.all() else np.flatnonzero(here)
        if rows is not None and not len(rows):
            return None
        raw = raw_values(data if rows is None else data[rows], lane.layout)
        value = physical_values(raw, lane.layout)
        self._drop_invalid(lane, group, rows, raw, value)
        if index is None:
            return rows, np.full(len(value), lane.index, np.intp), value
        return rows, index if rows is None else index[rows], value

    def _channels(self, lane: SignalBinding, group: MessageFrames) -> IntArray:
        assert lane.entry is not None
        n = len(group.frames)
        parts = {part: np.full(n, number) for part, number in lane.named_parts.items()}
        for part, signal in lane.numbers:
            values = physical_values(group.raw(signal.name), signal.layout)
            number = np.rint(values).astype(np.intp)
            carrying = group.carrying(signal)
            parts[part] = number if carrying is None else np.where(carrying, number, -1)
        return channel(lane.entry, self.lanes.segments[lane.kind], parts)

    def _drop_invalid(
        self,
        lane: SignalBinding,
        group: MessageFrames,
        rows: IntArray | None,
        raw: NDArray[np.uint64] | NDArray[np.int64],
        value: FloatArray,
    ) -> None:
        if lane.kind.startswith("state."):
            state = self.source.states[lane.kind.removeprefix("state.")]
            if state.mask:
                value[:] = (raw.astype(np.uint64) & np.uint64(state.mask)) != 0
            else:
                value[:] = np.isin(raw.astype(np.int64), state.equals)
            return
        entry = lane.entry
        if entry is None:
            return
        for code in entry.invalid:
            value[raw.astype(np.int64) == np.int64(code)] = np.nan
        if lane.flag is not None:
            flag = group.raw(lane.flag.name)
            flag_values = (flag if rows is None else flag[rows]) != 0
            value[flag_values != lane.flag_when_valid] = np.nan
        if entry.valid_range is not None:
            low, high = entry.valid_range
            value[(value < low) | (value > high)] = np.nan


def _both(one: BoolArray | None, other: BoolArray | None) -> BoolArray | None:
    if one is None or other is None:
        return other if one is None else one
    return one & other


def _has_orion_checksum(group: MessageFrames) -> BoolArray:
    """Last byte = id + length + sum of the bytes before, modulo 256."""
    frames = group.frames
    total = (frames.can_id & _ORION_ID).astype(np.int64) + frames.length + frames.data.sum(axis=1, dtype=np.int64)
    last = frames.data[np.arange(len(frames)), np.maximum(frames.length, 1).astype(np.intp) - 1].astype(np.int64)
    is_valid: BoolArray = ((total - last) & 0xFF) == last
    return is_valid


def _in_order(frames: Frames, parts: list[tuple[IntArray, IntArray, FloatArray]]) -> ChannelValues:
    rows = np.concatenate([part[0] for part in parts])
    index = np.concatenate([part[1] for part in parts])
    value = np.concatenate([part[2] for part in parts])
    if len(parts) > 1:
        order = np.argsort(rows, kind="stable")
        rows, index, value = rows[order], index[order], value[order]
    return ChannelValues(frames.t_ns[rows], index, value)
