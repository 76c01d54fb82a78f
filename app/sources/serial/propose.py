"""A serial profile out of captured bytes: header, length, checksum, and the arrays that look like cell voltages."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from app.battery.serial import Checksum, SerialMapping
from app.sources.serial.cell_arrays import FEWEST, SURE, ProposedArray, voltages_in
from app.sources.serial.checksums import is_sound
from app.sources.serial.framing import StreamReader
from app.sources.serial.propose_lines import ProposedHex, ProposedLine, propose_line

LOOKED_AT = 65_536  # bytes
MOST_FRAMES = 24  # that a checksum is tried on
MOST_LENGTH = 4096
KINDS = (
    "sum8",
    "xor8",
    "sum16",
    "sum16-complement",
    "crc-16/modbus",
    "crc-16/xmodem",
    "crc-16/ibm-3740",
    "crc-8",
    "crc-32",
)
_SIZES = {"sum8": 1, "xor8": 1, "crc-8": 1, "crc-32": 4}
_GRAM = 2
MOST_TRIED = 16  # beginnings of a frame of one length
_Rows = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class ProposedFrame:
    """A frame that comes again and again; without a checksum its beginning is to be confirmed."""

    header: bytes
    length: int
    seen: int
    end: bytes = b""
    checksum: Checksum | None = None
    voltages: ProposedArray | None = None


def fitting(data: bytes, mappings: Mapping[str, SerialMapping]) -> str | None:
    """Return the name of the mapping whose checksums hold in most of what was captured, None where none does."""
    best: tuple[float, str | None] = (0.5, None)
    for name, mapping in mappings.items():
        if any(frame.checksum is None for frame in mapping.frames) or mapping.lines:
            continue
        reader = StreamReader(mapping)
        frames = reader.feed(data[:LOOKED_AT], 0)
        share = sum(len(frame.raw) for frame in frames) / max(len(data[:LOOKED_AT]), 1)
        if len(frames) >= 2 and share > best[0]:
            best = share, name
    return best[1]


def propose(data: bytes) -> ProposedFrame | ProposedLine | ProposedHex | None:
    """Return what the bytes consist of; of several kinds of frames the one with the most cells."""
    data = data[:LOOKED_AT]
    line = propose_line(data)
    if line is not None:
        return line
    best: ProposedFrame | None = None
    for frame in _frames(data):
        if best is None or _worth(frame) > _worth(best):
            best = frame
    return best


def _worth(frame: ProposedFrame) -> tuple[int, bool, int]:
    return (0 if frame.voltages is None else frame.voltages.count, frame.checksum is not None, len(frame.header))


def profile_text(proposed: ProposedFrame | ProposedLine | ProposedHex, name: str, baud: int) -> str:
    """Return a profile, with what is to be confirmed in comments."""
    voltages = proposed.voltages
    n_cells = 0
    if isinstance(voltages, ProposedArray):
        n_cells = voltages.count
    elif isinstance(voltages, tuple):
        n_cells = voltages[1] - voltages[0] + 1
    lines = [
        "# To confirm: segments, cell, parity; add current, temperatures and SOC.",
        "[battery]",
        f'name = "{name}"',
        f"packs = [{max(n_cells, 1)}]",
        "",
        "[battery.temperatures]",
        "sensors = 0",
        "",
        "[serial]",
        f"baud = {baud}",
        "",
    ]
    if isinstance(proposed, ProposedLine):
        lines += ["[[serial.line]]", f'separator = "{proposed.separator}"']
        if isinstance(voltages, tuple):
            base = ", base = 16" if proposed.base == 16 else ""
            first, last, scale = voltages
            value = f'signal = "cells.voltage", columns = [{first}, {last}]{base}, scale = {scale:g}'
            lines.append(f"fields = [{{ {value} }}]")
        return "\n".join([*lines, ""])
    if isinstance(proposed, ProposedHex):
        lines.append("[[serial.line]]")
        lines += [f'begin = "{proposed.begin}"'] if proposed.begin else []
        lines.append("hex = true")
    else:
        lines += ["[[serial.frame]]", f'header = "{proposed.header.hex(" ").upper()}"', f"length = {proposed.length}"]
        lines += [f'end = "{proposed.end.hex(" ").upper()}"'] if proposed.end else []
    if proposed.checksum is None:
        lines.append("# no checksum was found: the beginning is to be confirmed")
    else:
        sum_ = proposed.checksum
        lines.append(
            f'checksum = {{ kind = "{sum_.kind}", from = {sum_.first}, to = {sum_.end}, at = {sum_.at}, '
            f'byte_order = "{sum_.byte_order}" }}'
        )
    if isinstance(voltages, ProposedArray):
        value = f'signal = "cells.voltage", type = "{voltages.type}", at = {voltages.at}, count = {voltages.count}'
        value += f", stride = {voltages.stride}" if voltages.stride else ""
        lines.append(f'fields = [{{ {value}, scale = {voltages.scale:g}, byte_order = "{voltages.byte_order}" }}]')
    return "\n".join([*lines, ""])


def _frames(data: bytes) -> Iterator[ProposedFrame]:
    """Yield what comes again at a distance: with each pair of bytes that does as its header."""
    raw = np.frombuffer(data, np.uint8)
    if len(raw) < 4 * FEWEST:
        return
    codes = raw[:-1].astype(np.uint32) << 8 | raw[1:]
    tried: Counter[int] = Counter()
    for code, count in Counter(codes.tolist()).most_common(400):
        places = np.flatnonzero(codes == code)
        gaps = np.diff(places)
        if count < FEWEST or not len(gaps):
            break
        length, times = Counter(gaps.tolist()).most_common(1)[0]
        if not 4 <= length <= MOST_LENGTH or times < SURE * len(gaps) or tried[length] >= MOST_TRIED:
            continue
        tried[length] += 1
        starts = places[places + length <= len(raw)]
        if len(starts) < FEWEST:
            continue
        rows = raw[starts[:, None] + np.arange(length)]
        yield _described(rows)


def _described(rows: _Rows) -> ProposedFrame:
    """The frames of a period, which may be several behind each other: with a checksum the first of them."""
    constant = (rows == rows[0]).mean(axis=0) >= SURE
    n_header = int(np.argmin(constant)) if not constant.all() else len(constant)
    header = bytes(rows[0][: max(_GRAM, min(n_header, 4))])
    frame = ProposedFrame(header, rows.shape[1], len(rows))
    with_sum = _with_checksum(frame, rows, constant)
    frame = with_sum or frame
    return replace(frame, voltages=voltages_in(rows[:, : frame.length]))


def _with_checksum(proposed: ProposedFrame, rows: _Rows, constant: NDArray[np.bool_]) -> ProposedFrame | None:
    different = np.unique(rows, axis=0)
    if len(different) < 2:  # the same bytes again and again prove nothing but a CRC
        different = rows[:1]
    frames = [bytes(row) for row in different[:MOST_FRAMES]]
    for length in _lengths(rows.shape[1]):
        for n_end in (0, 1, 2):
            if n_end and not constant[length - n_end : length].all():
                continue
            for checksum in _checksums(length, n_end):
                if sum(is_sound(checksum, frame[:length]) for frame in frames[:3]) < min(2, len(frames)):
                    continue
                good = sum(is_sound(checksum, frame[:length]) for frame in frames)
                if good >= SURE * len(frames) and (len(frames) > 1 or _SIZES.get(checksum.kind, 2) > 1):
                    end = frames[0][length - n_end : length]
                    return replace(proposed, length=length, end=end, checksum=checksum)
    return None


def _lengths(period: int) -> Sequence[int]:
    return range(period, 5, -1) if period <= 160 else (period,)


def _checksums(length: int, n_end: int) -> Iterator[Checksum]:
    for kind in KINDS:
        size = _SIZES.get(kind, 2)
        at = -(size + n_end)
        for first in range(min(5, length)):
            yield Checksum(kind, first, at, at, "big")
            if size > 1:
                yield Checksum(kind, first, at, at, "little")
