"""Serial frames into what cells, sensors and the whole battery read: by numpy's types, or columns of a line."""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from app.battery.battery import Battery
from app.battery.serial import PLAUSIBLE, TYPES, SerialField, SerialLine, SerialMapping
from app.estimation.arrays import BoolArray, FloatArray, IntArray
from app.sources.dbc.battery_decoder import ChannelValues
from app.sources.serial.framing import Framed
from app.sources.serial.patterns import groups_of

MOST_IMPLAUSIBLE = 0.25  # share of a frame without a checksum; with more it is no frame
STEP = {"voltage": 0.05, "temperature": 4.0}  # V, degC by which one channel moves against all others, at least
STEP_SCATTERS = 8.0
FEWEST = 4  # channels that show how all move
_ORDERS = {"little": "<", "big": ">"}


@dataclass(slots=True)
class _Steps:
    """What the channels of a kind were last: a jump of one that does not last is left out."""

    accepted: FloatArray
    offered: FloatArray
    least: float

    def sound(self, index: IntArray, value: FloatArray) -> BoolArray:
        """Return which of new values are no jump against all others, or one that came before, too."""
        moved = value - self.accepted[index]
        all_moved = float(np.nanmedian(moved)) if np.isfinite(moved).any() else 0.0
        apart = np.abs(moved - all_moved)
        scatter = float(np.nanmedian(apart)) if np.isfinite(apart).any() else 0.0
        most = max(self.least, STEP_SCATTERS * scatter)
        again = np.abs(value - self.offered[index] - all_moved) <= most
        is_sound = np.asarray((apart <= most) | again)  # the first of all waits for a second
        self.offered[index] = value
        self.accepted[index] = np.where(is_sound, value, self.accepted[index])
        return is_sound


@dataclass(slots=True)
class _Part:
    """What frames of one kind of value hold."""

    t_ns: list[int] = field(default_factory=list)
    index: list[IntArray] = field(default_factory=list)
    value: list[FloatArray] = field(default_factory=list)


class SerialDecoder:
    """Decodes the frames of one battery; of channels without a checksum it keeps the last values."""

    def __init__(self, battery: Battery, mapping: SerialMapping) -> None:
        self.battery = battery
        self._sizes = dict.fromkeys(("voltage", "balancing", "resistance"), battery.n_cells)
        self._sizes["temperature"] = battery.n_sensors
        self._steps = {
            kind: _Steps(np.full(self._sizes[kind], np.nan), np.full(self._sizes[kind], np.nan), least)
            for kind, least in STEP.items()
            if self._sizes[kind] >= FEWEST
        }
        self.implausible_frames = 0
        self.left_out = 0  # values

    def decode(self, frames: Iterable[Framed]) -> dict[str, ChannelValues]:
        """Return what the frames hold, by kind, as `BatteryDecoder.decode` does."""
        parts: dict[str, _Part] = defaultdict(_Part)
        for frame in frames:
            channels = self._of_frame(frame)
            for of, index, value in channels:
                part = parts[of.kind]
                part.t_ns.append(frame.t_ns)
                part.index.append(index)
                part.value.append(value)
        return {
            kind: ChannelValues(
                np.repeat(np.array(part.t_ns, np.int64), [len(indices) for indices in part.index]),
                np.concatenate(part.index),
                np.concatenate(part.value),
            )
            for kind, part in parts.items()
        }

    def _of_frame(self, frame: Framed) -> list[tuple[SerialField, IntArray, FloatArray]]:
        try:
            channels = [
                (of, *channel)
                for of, raw, shift in (_of_line(frame) if isinstance(frame.of, SerialLine) else _of_bytes(frame))
                if (channel := self._channels(of, raw, shift)) is not None
            ]
        except (ValueError, IndexError, UnicodeDecodeError):
            self.implausible_frames += 1
            return []
        checksum = None if isinstance(frame.of, SerialLine) else frame.of.checksum
        return channels if checksum is not None else self._plausible(channels)

    def _channels(self, of: SerialField, raw: FloatArray, shift: int) -> tuple[IntArray, FloatArray] | None:
        if of.kind.startswith("state."):
            code = int(raw[0])
            yes = bool(code & of.mask) if of.mask else code in (of.equals or (1,))
            return np.zeros(1, np.intp), np.array([float(yes)])
        value = raw * of.scale + of.offset
        if of.invalid:
            value[np.isin(raw, of.invalid)] = np.nan
        if of.valid_range is not None:
            value[(value < of.valid_range[0]) | (value > of.valid_range[1])] = np.nan
        if of.charge_is_positive:
            value = 0.0 - value
        size = self._sizes.get(of.kind)
        if size is None:
            return np.zeros(1, np.intp), value[:1]
        index = of.first + shift + np.arange(len(value), dtype=np.intp)
        is_inside = (index >= 0) & (index < size)
        return (index[is_inside], value[is_inside]) if is_inside.any() else None

    def _plausible(
        self, read: Sequence[tuple[SerialField, IntArray, FloatArray]]
    ) -> list[tuple[SerialField, IntArray, FloatArray]]:
        """A frame without a checksum: a value beyond what a battery can have, or a jump of one cell, is left out."""
        wrong = [~_is_plausible(of.kind, value) for of, _, value in read]
        if sum(is_wrong.sum() for is_wrong in wrong) > MOST_IMPLAUSIBLE * max(sum(map(len, wrong)), 1):
            self.implausible_frames += 1
            return []
        kept = []
        for (of, index, value), is_wrong in zip(read, wrong, strict=True):
            is_left_out = is_wrong
            steps = self._steps.get(of.kind)
            if steps is not None and len(index) >= FEWEST:
                is_left_out = is_wrong | ~steps.sound(index, np.where(is_wrong, np.nan, value))
            is_left_out = is_left_out & np.isfinite(value)
            self.left_out += int(is_left_out.sum())
            if not is_left_out.all():
                kept.append((of, index[~is_left_out], value[~is_left_out]))
        return kept


def _is_plausible(kind: str, value: FloatArray) -> BoolArray:
    low, high = PLAUSIBLE.get(kind, (-math.inf, math.inf))
    return np.asarray(np.isnan(value) | ((value >= low) & (value <= high)))


def _of_bytes(frame: Framed) -> Iterable[tuple[SerialField, FloatArray, int]]:
    for of in frame.of.fields:
        shift = 0
        if of.index is not None:
            number = int(_numbers(frame.raw, of.index.type, of.index.at, 1, 0, of.index.byte_order)[0])
            shift = (number - of.index.base) * of.count
            if shift < 0:
                continue
        if of.bits:
            width = 8 * np.dtype(TYPES[of.type]).itemsize
            words = _numbers(frame.raw, of.type, of.at, -(-of.count // width), of.stride, of.byte_order)
            bits = (words[:, None].astype(np.uint64) >> np.arange(width, dtype=np.uint64)) & np.uint64(1)
            yield of, bits.reshape(-1)[: of.count].astype(np.float64), shift
        else:
            raw = _numbers(frame.raw, of.type, of.at, of.count, of.stride, of.byte_order)
            yield of, raw.astype(np.float64), shift


def _numbers(raw: bytes, kind: str, at: int, count: int, stride: int, byte_order: str) -> np.ndarray:
    dtype = np.dtype(_ORDERS[byte_order] + TYPES[kind])
    at += len(raw) if at < 0 else 0
    if at < 0 or at + (count - 1) * (stride or dtype.itemsize) + dtype.itemsize > len(raw):
        raise ValueError("the frame is too short")
    return np.ndarray((count,), dtype, raw, at, (stride or dtype.itemsize,))


def _of_line(frame: Framed) -> Iterable[tuple[SerialField, FloatArray, int]]:
    of = frame.of
    assert isinstance(of, SerialLine)
    text = frame.raw.decode("ascii").strip()
    text = text[text.rfind(of.begin) + len(of.begin) :] if of.begin else text
    text = text.removesuffix(of.end) if of.end else text
    groups = groups_of(of.pattern, text) if of.pattern else {}
    columns = [] if of.pattern else _split(text, of.separator)
    for part in of.fields:
        if part.columns is not None:
            first, last = part.columns
            texts = columns[first : last + 1]
            if len(texts) != last - first + 1:
                raise ValueError("the line has too few columns")
        else:
            texts = _split(groups[part.group], of.separator)
        yield part, np.array([_number(one, part.base) for one in texts]), 0


def _split(text: str, separator: str) -> list[str]:
    return text.split() if not separator.strip() else text.split(separator)


def _number(text: str, base: int) -> float:
    text = text.strip()
    if base == 16:
        if not re.fullmatch(r"(0[xX])?[0-9a-fA-F]{1,16}", text):
            raise ValueError(text)
        return float(int(text, 16))
    if not re.fullmatch(r"[-+]?[0-9]{1,12}(\.[0-9]{0,12})?", text):
        return math.nan if text == "" else _raise(text)
    return float(text)


def _raise(text: str) -> float:
    raise ValueError(text)
