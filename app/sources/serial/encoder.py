"""Readings of a battery into the frames and lines of its serial profile: what the simulated battery sends."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from app.battery.battery import Battery
from app.battery.serial import (
    LONGEST_FRAME,
    SIGN_AND_MAGNITUDE,
    TYPES,
    SerialField,
    SerialFrame,
    SerialLine,
    SerialMapping,
)
from app.estimation.arrays import FloatArray, IntArray
from app.sources.serial.checksums import checksum_of

STREAM_S = 0.5  # between two frames that nobody asks for, at least; and LEAST_GAPS of silence
LEAST_GAPS = 3.0
_LONGEST_REQUEST = 1024  # bytes
Readings = Mapping[str, FloatArray]  # by kind, as `Values`
_ORDERS = {"little": "<", "big": ">"}


class SerialEncoder:
    """Answers requests, and sends what nobody asks for once it was started. Time comes with the calls."""

    def __init__(self, battery: Battery, mapping: SerialMapping) -> None:
        self._mapping = mapping
        self._sizes = dict.fromkeys(("voltage", "balancing", "resistance"), battery.n_cells)
        self._sizes["temperature"] = battery.n_sensors
        self._unasked = tuple(part for part in mapping.parts if not part.poll)
        gaps_s = [frame.gap_s for frame in mapping.frames if frame.gap_s is not None]
        self._every_s = max([STREAM_S, *(LEAST_GAPS * gap_s for gap_s in gaps_s)])
        self._streams = not mapping.port.start
        self._received = b""
        self._asked: list[SerialFrame | SerialLine] = []
        self._due_s = 0.0

    @property
    def due_s(self) -> float:
        """Return when something is to be sent [s]."""
        if self._asked:
            return 0.0
        return self._due_s if self._streams and self._unasked else math.inf

    def begin(self, now_s: float) -> None:
        """Start anew, as after a boot."""
        self._received, self._asked, self._due_s = b"", [], now_s
        self._streams = not self._mapping.port.start

    def receive(self, data: bytes, now_s: float) -> None:
        """Take bytes that reach the battery."""
        self._received += data
        port = self._mapping.port
        requests = [part.poll for part in self._mapping.parts if part.poll]
        for request in (port.start, port.stop, *requests):
            if not request or request not in self._received:
                continue
            self._received = self._received.replace(request, b"")
            self._asked += [part for part in self._mapping.parts if part.poll == request]
            if request == port.start:
                self._streams, self._due_s = True, now_s
            elif request == port.stop:
                self._streams = False
        self._received = self._received[-_LONGEST_REQUEST:]

    def bytes_due(self, now_s: float, readings: Readings) -> bytes:
        """Return what is sent now."""
        parts, self._asked = self._asked, []
        if self._streams and self._unasked and now_s >= self._due_s:
            parts = [*parts, *self._unasked]
            self._due_s = now_s + self._every_s
        return b"".join(self.encoded(part, readings) for part in parts)

    def encoded(self, part: SerialFrame | SerialLine, readings: Readings) -> bytes:
        """Return a frame or line; of a frame with a number of its own as many as hold all channels."""
        frames = [-(-self._sizes.get(field.kind, 1) // field.count) for field in part.fields if field.index is not None]
        numbers = range(max(frames, default=1))
        if isinstance(part, SerialLine) and part.is_hex:
            texts = [self._values(part.fields, bytearray(_span(part)), k, readings).hex().upper() for k in numbers]
            return b"".join(_ended(part, text) for text in texts)
        if isinstance(part, SerialLine):
            return b"".join(_ended(part, self._columns(part, number, readings)) for number in numbers)
        return b"".join(self._frame(part, number, readings) for number in numbers)

    def _frame(self, of: SerialFrame, number: int, readings: Readings) -> bytes:
        tail = len(of.end)
        if of.checksum is not None:
            algorithm = checksum_of(of.checksum.kind)
            assert algorithm is not None
            tail = max(tail, -of.checksum.at if of.checksum.at < 0 else 0)
        ends = [_end(field) for field in of.fields]
        frame = bytearray(of.length or max(*ends, len(of.header)) + tail)
        frame[: len(of.header)] = bytes(byte or 0 for byte in of.header)
        if of.length_at is not None:
            at = of.length_at
            frame[at.offset : at.offset + at.size] = (len(frame) - at.adds).to_bytes(at.size, at.byte_order)
        self._values(of.fields, frame, number, readings)
        if of.end:
            frame[-len(of.end) :] = of.end
        if of.checksum is not None and algorithm is not None:
            size, calc = algorithm
            at_byte = of.checksum.at % len(frame)
            value = calc(bytes(frame[of.checksum.first : of.checksum.end]))
            frame[at_byte : at_byte + size] = value.to_bytes(size, of.checksum.byte_order)
        return bytes(frame)

    def _values(self, fields: Sequence[SerialField], frame: bytearray, number: int, readings: Readings) -> bytearray:
        """Put the values of fields into a frame."""
        for field in fields:
            shift = 0
            if field.index is not None:
                shift = number * field.count
                _put(
                    frame,
                    field.index.type,
                    field.index.at,
                    0,
                    field.index.byte_order,
                    np.array([number + field.index.base]),
                )
            raw = _raw(field, readings, field.first + shift)
            if field.bits:
                raw = _words(raw, 8 * np.dtype(TYPES[field.type]).itemsize)
            if field.charging is not None:
                at = field.charging
                code = (at.mask or at.equals[0]) if raw[0] < 0 else 0
                _put(frame, at.type, at.at, 0, at.byte_order, np.array([code]))
                raw = np.abs(raw)
            if field.type == SIGN_AND_MAGNITUDE:
                raw = np.abs(raw) + 0x8000 * (raw < 0)
            _put(frame, field.type, field.at, field.stride, field.byte_order, raw)
        return frame

    @staticmethod
    def _columns(of: SerialLine, number: int, readings: Readings) -> str:
        texts: dict[int, str] = {}
        for field in of.fields:
            if field.columns is None:
                continue
            shift = 0
            if field.index is not None and field.index.column is not None:
                shift = number * field.count
                texts[field.index.column] = f"{number + field.index.base}"
            for k, value in enumerate(_raw(field, readings, field.first + shift)):
                digits = _hex(int(value)) if field.base == 16 else f"{int(value)}"
                texts[field.columns[0] + k] = f"{field.begin}{digits}{field.end}"
        return of.separator.join(texts.get(k, "0") for k in range(max(texts, default=0) + 1))


def _hex(value: int) -> str:
    """A number in hex: four digits, or eight where it needs them; a negative one as its complement."""
    n_digits = 4 if -0x8000 <= value <= 0xFFFF else 8
    return f"{value & (1 << 4 * n_digits) - 1:0{n_digits}X}"


def _span(of: SerialLine) -> int:
    """Bytes of a line in hex."""
    return max(_end(field) for field in of.fields)


def _ended(of: SerialLine, text: str) -> bytes:
    """A line with its begin, checksum and end."""
    line = (of.begin + text).encode("ascii")
    if of.checksum is not None:
        size, calc = checksum_of(of.checksum.kind) or (0, sum)
        line += b"0" * min(-of.checksum.at, LONGEST_FRAME)
        at = of.checksum.at % len(line)
        value = calc(line[of.checksum.first : of.checksum.end]).to_bytes(size, of.checksum.byte_order)
        line = line[:at] + value.hex().upper().encode("ascii") + line[at + 2 * size :]
    return line + (of.end or "\r\n").encode("ascii")


def _end(field: SerialField) -> int:
    size = np.dtype(TYPES[field.type]).itemsize
    count = -(-field.count // (8 * size)) if field.bits else field.count
    return 0 if field.at < 0 else field.at + (count - 1) * (field.stride or size) + size


def _raw(field: SerialField, readings: Readings, first: int) -> IntArray:
    """Return (count,) raw numbers: value = raw * scale + offset; the first invalid one where nothing is known."""
    values = readings.get(field.kind, np.full(1, np.nan))
    numbers = np.full(field.count, np.nan)
    part = values[first : first + field.count]
    numbers[: len(part)] = part
    if field.kind.startswith("state."):
        yes = field.mask or (field.equals or (1,))[0]
        no = 0 if field.mask or yes else 1
        return np.where(numbers == 1.0, yes, no).astype(np.int64)
    signed = -numbers if field.charge_is_positive else numbers
    raw = np.rint((signed - field.offset) / field.scale)
    return np.where(np.isnan(raw), field.invalid[0] if field.invalid else 0, raw).astype(np.int64)


def _words(bits: IntArray, width: int) -> IntArray:
    padded = np.zeros(-(-len(bits) // width) * width, np.int64)
    padded[: len(bits)] = bits
    return np.asarray((padded.reshape(-1, width) << np.arange(width)).sum(axis=1))


def _put(frame: bytearray, kind: str, at: int, stride: int, byte_order: str, raw: IntArray) -> None:
    dtype = np.dtype(_ORDERS[byte_order] + TYPES[kind])
    at += len(frame) if at < 0 else 0
    view = np.ndarray((len(raw),), dtype, frame, at, (stride or dtype.itemsize,))
    if dtype.kind in "iu":
        limits = np.iinfo(dtype)
        raw = np.clip(raw, max(limits.min, -(2**63)), min(limits.max, 2**63 - 1))
    view[:] = raw
