"""Serial frames into what cells, sensors and the whole battery read: by numpy's types, or columns of a line."""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from app.battery.battery import Battery
from app.battery.serial import PLAUSIBLE, SIGN_AND_MAGNITUDE, TYPES, SerialField, SerialLine, SerialMapping
from app.estimation.arrays import BoolArray, FloatArray, IntArray
from app.sources.dbc.battery_decoder import ABSENT_DEGC, ChannelValues
from app.sources.serial.framing import Framed
from app.sources.serial.patterns import groups_of

MOST_IMPLAUSIBLE = 0.25  # share of a frame without a checksum; with more it is no frame
STEP = {"voltage": 0.05, "temperature": 4.0}  # V, degC by which one channel moves against all others, at least
STEP_OF_ALL = {"current": 100.0, "pack_voltage": 50.0, "soc": 0.02}  # A, V, a fraction of 1 from one value to the next
STEP_SCATTERS = 8.0
CONFIRMED = 2  # times that a jump comes again until it counts: two damaged values in a row may be alike
FEWEST = 4  # channels that show how all move
_LEAST_DIGITS, _MOST_OF = 3, 0.9  # digits, and share of the columns that have as many
_SEPARATORS = 0.95  # share of separators in their places, that a shift of a few columns does not leave
_DECIMAL = re.compile(r"[-+]?(?:[0-9]{1,10}(?:\.[0-9]{0,12})?|\.[0-9]{1,12})(?:[eE][-+]?[0-9]{1,2})?")
_HEX = re.compile(r"(?:0[xX])?([0-9a-fA-F]{1,8})")
_ORDERS = {"little": "<", "big": ">"}


@dataclass(slots=True)
class _Steps:
    """What the channels of a kind were last: a jump that does not last is left out."""

    accepted: FloatArray
    offered: FloatArray
    repeated: IntArray  # times that what is offered came before
    least: float
    confirmed: int

    @classmethod
    def of(cls, n: int, least: float, confirmed: int = CONFIRMED) -> _Steps:
        """Nothing is known of n channels."""
        return cls(np.full(n, np.nan), np.full(n, np.nan), np.zeros(n, np.intp), least, confirmed)

    def sound(self, index: IntArray, value: FloatArray) -> BoolArray:
        """Return which of new values are no jump against all others, or one that came before, too."""
        if len(self.accepted) == 1:
            return self._sound_alone(value)
        moved = value - self.accepted[index]
        all_moved = float(np.nanmedian(moved)) if np.isfinite(moved).any() else 0.0
        apart = np.abs(moved - all_moved)
        scatter = float(np.nanmedian(apart)) if np.isfinite(apart).any() else 0.0
        most = max(self.least, STEP_SCATTERS * scatter)
        is_known = np.isfinite(self.accepted[index])
        again = self._again(index, np.abs(value - self.offered[index] - all_moved) <= most)
        is_sound = np.asarray((apart <= most) | (again >= np.where(is_known, self.confirmed, 1)))
        self.offered[index] = value
        self.accepted[index] = np.where(is_sound, value, self.accepted[index])
        return is_sound

    def _again(self, index: IntArray, is_same: BoolArray) -> IntArray:
        """How often each value came before in a row."""
        self.repeated[index] = np.where(is_same, self.repeated[index] + 1, 0)
        return self.repeated[index]

    def _sound_alone(self, value: FloatArray) -> BoolArray:
        """The same of a value of the whole battery, of which the first counts."""
        again = self._again(np.zeros(1, np.intp), np.abs(value - self.offered) <= self.least)
        is_near = np.abs(value - self.accepted) <= self.least
        is_sound = np.asarray(is_near | (again >= self.confirmed) | np.isnan(self.accepted))
        self.offered[:] = value
        self.accepted[:] = np.where(is_sound, value, self.accepted)
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
            kind: _Steps.of(self._sizes[kind], least) for kind, least in STEP.items() if self._sizes[kind] >= FEWEST
        }
        self._steps |= {kind: _Steps.of(1, least) for kind, least in STEP_OF_ALL.items()}
        self._steps["current"].confirmed = 1  # which steps in earnest: one sample late is enough
        self.implausible_frames = 0
        self.left_out = 0  # values
        self.absent = 0  # temperatures of sensors that are not connected

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
                for of, raw, shift, sign in _fields_of(frame)
                if (channel := self._channels(of, raw, shift, sign)) is not None
            ]
        except (ValueError, IndexError, UnicodeDecodeError):
            self.implausible_frames += 1
            return []
        if frame.of.checksum is None:
            return self._plausible(channels)
        for of, _, value in channels:
            value[np.isinf(value) | self._is_absent(of, value)] = np.nan
        return channels

    def _is_absent(self, of: SerialField, value: FloatArray) -> BoolArray:
        """Which temperatures are of a sensor that is not connected; counts them."""
        is_absent = np.asarray((value <= ABSENT_DEGC) & (of.kind == "temperature"))
        self.absent += int(np.count_nonzero(is_absent))
        return is_absent

    def _channels(self, of: SerialField, raw: FloatArray, shift: int, sign: int) -> tuple[IntArray, FloatArray] | None:
        if of.kind.startswith("state."):
            if not np.isfinite(raw[0]):
                raise ValueError("a state is no number")
            code = int(raw[0])
            yes = bool(code & of.mask) if of.mask else code in (of.equals or (1,))
            return np.zeros(1, np.intp), np.array([float(yes)])
        value = raw * of.scale + of.offset
        if of.invalid:
            value[np.isin(raw, of.invalid)] = np.nan
        if of.valid_range is not None:
            is_valid = (value >= of.valid_range[0]) & (value <= of.valid_range[1])
            value[~is_valid & np.isfinite(value)] = np.nan
        if sign < 0 or (of.charge_is_positive and of.charging is None):
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
            if steps is not None and (len(index) >= FEWEST or len(steps.accepted) == 1):
                is_left_out = is_wrong | ~steps.sound(index, np.where(is_wrong, np.nan, value))
            is_left_out = is_left_out & ~np.isnan(value)
            self.left_out += int(is_left_out.sum())
            is_left_out = is_left_out | self._is_absent(of, np.where(is_wrong, np.nan, value))
            if not is_left_out.all():
                kept.append((of, index[~is_left_out], value[~is_left_out]))
        return kept


def _is_plausible(kind: str, value: FloatArray) -> BoolArray:
    low, high = PLAUSIBLE.get(kind, (-math.inf, math.inf))
    return np.asarray(np.isnan(value) | ((value >= low) & (value <= high)))


def _fields_of(frame: Framed) -> Iterable[tuple[SerialField, FloatArray, int, int]]:
    """Yield a field, its raw numbers, by how many channels they are shifted, and -1 for a current that charges."""
    if not isinstance(frame.of, SerialLine):
        return _of_bytes(frame.raw, frame.of.fields)
    text = _text_of(frame.of, frame.raw)
    return _of_bytes(bytes.fromhex(text), frame.of.fields) if frame.of.is_hex else _of_columns(frame.of, text)


def _of_bytes(data: bytes, fields: Iterable[SerialField]) -> Iterable[tuple[SerialField, FloatArray, int, int]]:
    for of in fields:
        shift, sign = 0, 1
        if of.index is not None:
            number = int(_numbers(data, of.index.type, of.index.at, 1, 0, of.index.byte_order)[0])
            shift = (number - of.index.base) * of.count
            if shift < 0:
                continue
        if of.charging is not None:
            at = of.charging
            code = int(_numbers(data, at.type, at.at, 1, 0, at.byte_order)[0])
            sign = -1 if (code & at.mask if at.mask else code in at.equals) else 1
        if of.bits:
            width = 8 * np.dtype(TYPES[of.type]).itemsize
            words = _numbers(data, of.type, of.at, -(-of.count // width), of.stride, of.byte_order)
            bits = (words[:, None].astype(np.uint64) >> np.arange(width, dtype=np.uint64)) & np.uint64(1)
            yield of, bits.reshape(-1)[: of.count].astype(np.float64), shift, sign
        else:
            raw = _numbers(data, of.type, of.at, of.count, of.stride, of.byte_order)
            yield of, raw.astype(np.float64), shift, sign


def _numbers(raw: bytes, kind: str, at: int, count: int, stride: int, byte_order: str) -> np.ndarray:
    dtype = np.dtype(_ORDERS[byte_order] + TYPES[kind])
    at += len(raw) if at < 0 else 0
    if at < 0 or at + (count - 1) * (stride or dtype.itemsize) + dtype.itemsize > len(raw):
        raise ValueError("the frame is too short")
    numbers = np.ndarray((count,), dtype, raw, at, (stride or dtype.itemsize,))
    if kind != SIGN_AND_MAGNITUDE:
        return numbers
    size = (numbers & 0x7FFF).astype(np.int32)
    return np.where(numbers & 0x8000, -size, size)


def _text_of(of: SerialLine, raw: bytes) -> str:
    """What stands between the begin and the end of a line."""
    text = raw.decode("ascii", "replace").strip()
    text = text[text.rindex(of.begin) if of.begin else 0 :].removesuffix(of.end)
    if of.checksum is not None and of.checksum.at % max(len(text), 1) >= of.checksum.end % max(len(text), 1):
        text = text[: of.checksum.end]  # the checksum is behind
    return text.removeprefix(of.begin)


def _of_columns(of: SerialLine, text: str) -> Iterable[tuple[SerialField, FloatArray, int, int]]:
    groups = groups_of(of.pattern, text) if of.pattern else {}
    columns = [] if of.pattern else _split(text, of.separator)
    if of.checksum is None and not of.pattern:
        columns = _aligned(columns, text, of)
    for part in of.fields:
        if part.columns is not None:
            first, last = part.columns
            texts = columns[first : last + 1]
            if len(texts) != last - first + 1:
                raise ValueError("the line has too few columns")
        else:
            texts = _split(groups[part.group], of.separator)
        if of.checksum is None and _is_shifted(texts):
            raise ValueError("a separator is damaged")
        shift = 0
        if part.index is not None:
            at = part.index
            numbers = re.findall("[0-9]{1,5}", groups[at.group] if at.column is None else columns[at.column])
            shift = (int(numbers[-1]) - at.base) * max(part.count, len(texts))
        yield part, np.array([_number(text, part) for text in texts]), shift, 1


def _plain(text: str, of: SerialField) -> str:
    """What is between the begin and the end of a column."""
    text = text.strip()
    if of.begin:
        text = text.rpartition(of.begin)[2]
    return text.removesuffix(of.end).strip() if of.end else text


def _aligned(columns: list[str], text: str, of: SerialLine) -> list[str]:
    """The columns, by their places where a separator among columns of one width is damaged.

    Raises:
        ValueError: it is, and a character is missing or too many: the columns after it are of others.
    """
    n = 1 + max(field.columns[1] for field in of.fields if field.columns is not None)
    if len(columns) == n and not _is_shifted(columns):
        return columns
    sizes = [len(column) for column in columns]
    width = max(set(sizes), key=sizes.count, default=0)
    between = text[width :: width + 1]  # the separators, where none of the columns is shifted
    has_places = len(of.separator) == 1 and len(text) == n * (width + 1) - 1
    if has_places and between.count(of.separator) >= _SEPARATORS * len(between):
        return [text[at : at + width] for at in range(0, len(text), width + 1)]
    if _is_shifted(columns):
        raise ValueError("a separator is damaged")
    return columns


def _is_shifted(texts: Sequence[str]) -> bool:
    """Whether two columns, nearly all of one length, became one, or one became two: those after it are of others."""
    sizes = [len(text) for text in texts]
    usual = max(set(sizes), key=sizes.count, default=0)
    if usual < _LEAST_DIGITS or sizes.count(usual) < _MOST_OF * len(sizes):
        return False
    has_joined = any(
        size >= 2 * usual and not text.upper().startswith("F") for size, text in zip(sizes, texts, strict=True)
    )  # eight digits of a negative number begin with F
    return has_joined or any(one + next_one + 1 == usual for one, next_one in pairwise(sizes))


def _split(text: str, separator: str) -> list[str]:
    return text.split() if not separator.strip() else text.split(separator)


def _number(text: str, of: SerialField) -> float:
    """A number; infinite where the text is none: damaged, or a word for "not measured"."""
    text = _plain(text, of)
    if text == "":
        return math.nan
    if of.base == 10:
        return float(text) if _DECIMAL.fullmatch(text) else math.inf
    digits = _HEX.fullmatch(text)
    if digits is None:
        return math.inf
    number, n_bits = int(digits[1], 16), 4 * len(digits[1])
    return float(number - (1 << n_bits if of.is_signed and number >> (n_bits - 1) else 0))
