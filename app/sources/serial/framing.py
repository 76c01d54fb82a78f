"""Frames in a stream of bytes, by a profile: resynchronises behind any damage, holds no more than one frame."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from app.battery.serial import LONGEST_FRAME, SerialFrame, SerialLine, SerialMapping
from app.sources.serial.checksums import is_sound, is_sound_line
from app.sources.serial.patterns import is_match

IDLE_NS = 200_000_000  # silence after which an incomplete frame is dropped
_LAST_BYTES = 64


@dataclass(frozen=True, slots=True)
class Framed:
    """A whole frame or line."""

    t_ns: int  # when its last byte was read
    of: SerialFrame | SerialLine
    raw: bytes


class StreamReader:
    """Call `feed` with what is read, and `idle` where nothing is.

    A frame with a checksum is one once that holds. One without is followed by another one or by silence: else bytes
    were lost within it, and it is left out.
    """

    def __init__(self, mapping: SerialMapping) -> None:
        self._framed = tuple(frame for frame in mapping.frames if frame.header)
        self._by_gap = tuple(frame for frame in mapping.frames if not frame.header)
        self._lines = mapping.lines
        gaps_s = [frame.gap_s for frame in self._by_gap if frame.gap_s is not None]
        self.silence_ns = round(1e9 * min(gaps_s)) if gaps_s else IDLE_NS
        self._data = bytearray()
        self._pieces: list[tuple[int, int]] = []  # (end in `_data`, time) of each piece that was read
        self._last_ns: int | None = None
        self.frames = self.bad_frames = self.skipped_bytes = 0
        self.last = b""  # last bytes that were read

    def feed(self, data: bytes, t_ns: int) -> list[Framed]:
        """Take bytes that were read at a time [ns], in order; return the frames that are complete."""
        framed = self.idle(t_ns)
        if not data:
            return framed
        self._last_ns = t_ns
        self.last = (self.last + data)[-_LAST_BYTES:]
        self._data += data
        self._pieces.append((len(self._data), t_ns))
        if self._lines:
            framed += self._take_lines()
        elif self._framed:
            framed += self._take_frames(is_over=False)
        elif len(self._data) > 2 * LONGEST_FRAME:
            self._bad(len(self._data))
        return framed

    def idle(self, t_ns: int) -> list[Framed]:
        """Return the frames that silence up to a time completes."""
        if self._last_ns is None or not self._data or t_ns - self._last_ns < self.silence_ns:
            return []
        if self._lines:
            return []
        if self._framed:
            return list(self._take_frames(is_over=True))
        return list(self._take_gap())

    def _take_gap(self) -> Iterator[Framed]:
        of = next((frame for frame in self._by_gap if frame.length == len(self._data)), None)
        if of is not None and self._is_whole(of, bytes(self._data)):
            yield self._frame(of, len(self._data))
        else:
            self._bad(len(self._data))

    def _take_frames(self, *, is_over: bool) -> Iterator[Framed]:
        while self._data:
            starts = [frame for frame in self._framed if _begins(self._data, 0, frame)]
            if not starts:
                self._skip(self._next_start())
                continue
            waits = False
            for of in starts:
                length = self._length(of)
                if length is None or length > len(self._data):
                    waits |= length is None or length <= LONGEST_FRAME
                    continue
                if not self._is_whole(of, bytes(self._data[:length])):
                    continue
                if of.checksum is None and not self._is_followed(length, is_over=is_over):
                    waits |= length == len(self._data) and not is_over
                    continue
                yield self._frame(of, length)
                break
            else:
                if waits and not is_over:
                    return
                self.bad_frames += 1
                self._skip(1)

    def _length(self, of: SerialFrame) -> int | None:
        """Return the length of the frame that begins here, None where that is not read yet."""
        at = of.length_at
        if at is None:
            return of.length or LONGEST_FRAME + 1
        stored = self._data[at.offset : at.offset + at.size]
        if len(stored) < at.size:
            return None
        length = int.from_bytes(stored, at.byte_order) + at.adds
        return length if length > max(len(of.header), at.offset + at.size - 1) else LONGEST_FRAME + 1

    @staticmethod
    def _is_whole(of: SerialFrame, frame: bytes) -> bool:
        return frame.endswith(of.end) and (of.checksum is None or is_sound(of.checksum, frame))

    def _is_followed(self, length: int, *, is_over: bool) -> bool:
        if length == len(self._data):
            return is_over
        return any(_begins(self._data, length, frame) for frame in self._framed)

    def _next_start(self) -> int:
        """Where the next frame may begin: its first byte is found fast, the rest is compared."""
        starts = [len(self._data)]
        for frame in self._framed:
            first = frame.header[0]
            at = 1
            while at < min(starts):
                at = at if first is None else self._data.find(first, at)
                if at < 0 or _begins(self._data, at, frame):
                    break
                at += 1
            if at >= 0:
                starts.append(at)
        return min(starts)

    def _take_lines(self) -> Iterator[Framed]:
        end = self._lines[0].end.encode()
        while True:
            at, size = _first_end(self._data, end)
            if at < 0:
                if len(self._data) > LONGEST_FRAME:
                    self._bad(len(self._data))
                return
            line = bytes(self._data[:at])
            layouts = [layout for layout in self._lines if _may_be(line, layout)]
            of = next((layout for layout in layouts if _is_sound(line, layout)), None)
            if not line.strip():
                self._drop(at + size)
            elif not layouts:
                self._skip(at + size)  # what else the battery prints
            elif of is None or at > LONGEST_FRAME:
                self._bad(at + size)
            else:
                yield self._frame(of, at + size)

    def _frame(self, of: SerialFrame | SerialLine, length: int) -> Framed:
        raw = bytes(self._data[:length])
        t_ns = next(t_ns for end, t_ns in self._pieces if end >= length)
        self.frames += 1
        self._drop(length)
        return Framed(t_ns, of, raw)

    def _bad(self, length: int) -> None:
        self.bad_frames += 1
        self._skip(length)

    def _skip(self, length: int) -> None:
        self.skipped_bytes += length
        self._drop(length)

    def _drop(self, length: int) -> None:
        del self._data[:length]
        self._pieces = [(end - length, t_ns) for end, t_ns in self._pieces if end > length]


def frame_counter(mapping: SerialMapping) -> Callable[[bytes], int]:
    """Return what counts the frames in bytes as they are read now."""
    reader = StreamReader(mapping)
    return lambda data: len(reader.feed(data, time.monotonic_ns()))


def _begins(data: bytearray, at: int, of: SerialFrame) -> bool:
    """Whether a frame may begin here, as far as the bytes go."""
    part = data[at : at + len(of.header)]
    return all(wanted is None or byte == wanted for byte, wanted in zip(part, of.header, strict=False))


def _may_be(line: bytes, of: SerialLine) -> bool:
    return of.begin.encode() in line and (not of.pattern or is_match(of.pattern, line.decode("ascii", "replace")))


def _is_sound(line: bytes, of: SerialLine) -> bool:
    begin = line.rfind(of.begin.encode()) if of.begin else 0
    return of.checksum is None or is_sound_line(of.checksum, line[begin:])


def _first_end(data: bytearray, end: bytes) -> tuple[int, int]:
    """Return where the first line ends and how long its end is, (-1, 0) where none does."""
    if end:
        return data.find(end), len(end)
    ends = [at for at in (data.find(b"\n"), data.find(b"\r")) if at >= 0]
    return (min(ends), 1) if ends else (-1, 0)
