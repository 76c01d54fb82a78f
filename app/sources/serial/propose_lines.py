"""Lines of text out of captured bytes: their separator, or that they are bytes in hex, and their cell voltages."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from app.battery.serial import ByteOrder, Checksum
from app.sources.serial.cell_arrays import (
    CELL_V,
    FEWEST,
    LEAST_CELLS,
    NEIGHBOUR_V,
    SCALES,
    SURE,
    ProposedArray,
    runs,
    voltages_in,
)
from app.sources.serial.checksums import checksum_of, is_sound_line

_LEAST_NUMBERS = 0.5  # share of the columns of a line
_HEX_LINE = re.compile(r"([^0-9A-Fa-f\s]?)((?:[0-9A-Fa-f]{2}){8,})")  # a first character, bytes in hex
_SUMS = ("sum16-complement", "sum16", "crc-16/modbus", "crc-16/xmodem", "sum8", "xor8")


@dataclass(frozen=True, slots=True)
class ProposedLine:
    """Lines of text with as many columns each."""

    separator: str
    columns: int
    seen: int
    base: int
    voltages: tuple[int, int, float] | None = None  # first and last column, scale


@dataclass(frozen=True, slots=True)
class ProposedHex:
    """Lines of bytes in hex, of one length."""

    begin: str
    length: int  # bytes
    seen: int
    checksum: Checksum | None = None
    voltages: ProposedArray | None = None


def propose_line(data: bytes) -> ProposedLine | ProposedHex | None:
    """Return what lines of text consist of, None where the bytes are none."""
    try:
        text = data.decode("ascii")
    except UnicodeDecodeError:
        return None
    rows = [line for line in text.replace("\r", "\n").split("\n")[1:-1] if line.strip()]
    if len(rows) < FEWEST:
        return None
    in_hex = _hex_lines(rows)
    if in_hex is not None:
        return in_hex
    for separator in (",", ";", "\t", " "):
        columns = [row.split() if separator == " " else row.split(separator) for row in rows]
        n, times = Counter(map(len, columns)).most_common(1)[0]
        if n < LEAST_CELLS or times < SURE * len(rows):
            continue
        whole = [column for column in columns if len(column) == n]
        by_base = {base: _numbers(whole, base) for base in (10, 16)}
        shares = {base: float(np.isfinite(numbers).mean()) for base, numbers in by_base.items()}
        base = 16 if shares[16] > shares[10] else 10  # hex digits of some numbers are decimal ones
        if shares[base] > _LEAST_NUMBERS:
            return _with_voltages(ProposedLine(separator, n, len(whole), base), by_base[base])
    return None


def _numbers(rows: Sequence[Sequence[str]], base: int) -> NDArray[np.float64]:
    """The columns as numbers, NaN for a word."""

    def number(text: str) -> float:
        try:
            return float(text) if base == 10 else float(int(text, 16))
        except ValueError:
            return np.nan

    return np.array([[number(text) for text in row] for row in rows])


def _with_voltages(line: ProposedLine, numbers: NDArray[np.float64]) -> ProposedLine:
    best: tuple[int, int, float] | None = None
    for scale in (1.0, *SCALES):
        volts = numbers * scale
        fits = ((volts >= CELL_V[0]) & (volts <= CELL_V[1])).mean(axis=0) >= SURE
        near = (np.abs(np.diff(volts, axis=1)) <= NEIGHBOUR_V).mean(axis=0) >= SURE
        for first, last in runs(fits, near):
            if last - first + 1 >= LEAST_CELLS and (best is None or last - first > best[1] - best[0]):
                best = first, last, scale
    return replace(line, voltages=best)


def _hex_lines(rows: Sequence[str]) -> ProposedHex | None:
    """Lines of one first character and as many hex digits; of several lengths the most frequent."""
    matches = [match for row in rows if (match := _HEX_LINE.fullmatch(row.strip())) is not None]
    if len(matches) < SURE * len(rows):
        return None
    (begin, n_digits), seen = Counter((match[1], len(match[2])) for match in matches).most_common(1)[0]
    if seen < FEWEST:
        return None
    lines = [match[0] for match in matches if (match[1], len(match[2])) == (begin, n_digits)]
    data = np.array([list(bytes.fromhex(line[len(begin) :])) for line in lines], np.uint8)
    return ProposedHex(begin, n_digits // 2, seen, _checksum(lines, len(begin)), voltages_in(data))


def _checksum(lines: Sequence[str], n_begin: int) -> Checksum | None:
    orders: tuple[ByteOrder, ...] = ("big", "little")
    for kind in _SUMS:
        size = (checksum_of(kind) or (2, None))[0]
        for first in dict.fromkeys((n_begin, 0)):
            for order in orders:
                checksum = Checksum(kind, first, -2 * size, -2 * size, order)
                if all(is_sound_line(checksum, line.encode()) for line in lines):
                    return checksum
    return None
