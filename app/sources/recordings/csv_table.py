"""Finds the table in a CSV file as test rigs write it: preamble, units, decimal commas, words among numbers."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from datetime import datetime, timedelta
from io import StringIO
from typing import NamedTuple, TypeVar

import numpy as np

from app.estimation.arrays import FloatArray
from app.estimation.errors import DatasetError
from app.sources.recordings.bad_rows import REFUSED_SHARE, BadRows
from app.sources.recordings.kind import text_of, wide_encoding, without_nul_runs
from app.sources.recordings.quantities import is_unit, state_of, states_direction
from app.words import Message, render

MISSING = frozenset({"", "nan", "na", "n/a", "null", "none", "-", "--"})
DELIMITERS = (";", "\t", ",")
CLOCK = re.compile(r"(?:(\d+)d ?)?(\d{1,4}):([0-5]?\d)(?::([0-5]?\d(?:\.\d+)?))?")
DATE = re.compile(r"(\d{1,2})([./])(\d{1,2})\2(\d{4})(?=[ T])")
SLASH_DATE = re.compile(r"(?<![\d/])(\d{1,2})/(\d{1,2})/(\d{4})(?=[ T,;\t]|$)", re.MULTILINE)
HALF_DAY = re.compile(r"(.*\D)(\d{1,2})(:\d{2}(?::\d{2}(?:\.\d+)?)?) ?([AP])M", re.IGNORECASE)
MONTH_BY_NAME = re.compile(r"(\d{1,2})[- ]([A-Z][a-z]{2})[- ](\d{2}|\d{4})(?=[ T])")
MONTHS = ["Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"]
HEADER_STAMP = re.compile(
    r"\d{1,4}([-./])\d{1,2}\1\d{1,4}[ T,;\t]{1,3}\d{1,2}:\d{2}(?::\d{2}(?:\.\d{1,9})?)?(?: ?[AP]M)?"
    r"|\d{1,2}[- ][A-Z][a-z]{2}[- ]\d{2,4}[ T]{1,2}\d{1,2}:\d{2}(?::\d{2})?"
)
STARTED = re.compile(r"\b(?:start|begin|began|beginn)", re.IGNORECASE)
DATED = re.compile(r"\b(?:date|datum|dato|time|recorded|acquired|acquisition)", re.IGNORECASE)
WRITTEN = re.compile(r"\b(?:export|print|creat|report)", re.IGNORECASE)  # dates of the file itself
ALONE = re.compile(r"\d{1,4}([-./])\d{1,2}\1\d{1,4}")  # a date without its time of day
DECIMAL_COMMA = re.compile(r"(?<![\d,])(-?\d+),(\d+(?:[eE][-+]?\d+)?)(?![\d,])")
HEADER_LINES = re.compile(r"Nb header lines\s*:\s*(\d{1,9})\b", re.ASCII)  # BioLogic: the names are the last of them
MOST_COLUMNS = 10_000
PREAMBLE_LIMIT = 500  # lines of remarks a rig may write before its table
ENDS_COMPARED = 20  # last rows, which show how rows end
ROWS_ALIKE = 5  # rows of the same kind that make a table where some columns hold words


T = TypeVar("T")
OnRows = Callable[[int, int], None]  # rows read, rows in all
_PROGRESS_EVERY = 5000  # rows


class TableUnreadable(DatasetError):
    """There is no table in the file; `reason` says why in any language."""

    def __init__(self, source: str, reason: Message) -> None:
        super().__init__(source, render(reason))
        self.reason = reason


class CsvTable(NamedTuple):
    """Contents of a CSV file."""

    header: list[str] | None  # None: it has none
    columns: list[FloatArray]  # NaN where no number stands
    started_unix_s: float | None  # by the lines above the table


def read_csv(source: str, raw: bytes, notes: list[Message], on_read: OnRows = lambda done, of: None) -> CsvTable:
    """Return the table in a CSV file.

    Args:
        source: name of the file, for the error.
        raw: its bytes, in any of the encodings of `text_of`.
        notes: gets what was done.
        on_read: called with how many rows are read, and of how many.

    Raises:
        TableUnreadable: it holds no table of numbers.
    """
    if not wide_encoding(raw) and (of_words := without_nul_runs(raw)) != raw:
        notes.append(Message("nul-bytes", n=raw.count(b"\0")))
        raw = of_words
    text = text_of(raw)
    if "\0" in text:
        raise TableUnreadable(source, Message("no-text"))
    lines = text.splitlines()
    first_row = next((match for line in lines[:5] if (match := HEADER_LINES.match(line))), None)
    above = max(int(first_row[1]) - 1, 0) if first_row is not None and int(first_row[1]) <= len(lines) else 0
    numbers = [above + k for k, line in enumerate(lines[above:], 1) if line.strip()]
    lines = [lines[number - 1] for number in numbers]
    if not lines:
        raise TableUnreadable(source, Message("file-empty"))
    is_delimited = any(delimiter in line for line in lines[:PREAMBLE_LIMIT] for delimiter in DELIMITERS)
    if not is_delimited:
        lines = ["\t".join(line.split()) for line in lines]
    if '"' in text:
        lines = _without_quotes(source, lines)
        numbers = numbers if len(numbers) == len(lines) else []
    if any(_has_decimal_commas(line) for line in lines[-20:]):
        lines = [DECIMAL_COMMA.sub(r"\1.\2", line) for line in lines]
        notes.append(Message("decimal-commas"))
    lines = _without_empty_ends(lines)
    delimiter, start = _find_table(source, lines, is_delimited)
    header, header_lines = _header_above(lines, start, delimiter)
    body = _with_day_first(lines[start:])
    width = len(body[0].split(delimiter))
    skipped = above + start - header_lines
    if skipped:
        notes.append(Message("lines-above", lines=skipped))
    columns = _numbers(source, body, numbers[start:], delimiter, width, notes, on_read)
    _add_dates(body, delimiter, columns)
    for k, name in enumerate(header or []):
        if states_direction(name) and np.isnan(columns[k]).all():
            states = [state_of(tokens[k]) for line in body if len(tokens := line.split(delimiter)) == width]
            columns[k] = np.array(states) if any(states) else columns[k]
    return CsvTable(header, columns, _started_s(lines[: start - header_lines]))


def _started_s(above: list[str]) -> float | None:
    """Return the time that the lines above a table give as its start [s since 1970], or else as its date."""
    stamps = [(line[: stamp.start()], _stamp_s(" ".join(stamp[0].replace(",", " ").split())))
             for line in above if (stamp := HEADER_STAMP.search(line)) is not None]  # fmt: skip
    for words in (STARTED, DATED):
        for name, seconds in stamps:
            if seconds is not None and words.search(name) and not WRITTEN.search(name):
                return seconds
    return None


def _add_dates(body: list[str], delimiter: str, columns: list[FloatArray]) -> None:
    """Add the dates of a column to the times of day in another one."""
    first = [token.strip(' \t"') for token in body[0].split(delimiter)]
    dated = [k for k, token in enumerate(first) if ALONE.fullmatch(token)]
    clocks = [k for k, token in enumerate(first) if CLOCK.fullmatch(token)]
    if len(dated) != 1 or len(clocks) != 1 or len(columns[clocks[0]]) != len(body):
        return
    dates = [line.split(delimiter)[dated[0]].strip(' \t"') for line in body]
    at_s = {date: _stamp_s(f"{date} 00:00:00") for date in set(dates)}
    if None not in at_s.values():
        columns[clocks[0]] = columns[clocks[0]] + np.array([at_s[date] for date in dates])


def _with_day_first(body: list[str]) -> list[str]:
    """Return rows with 31/12/2026 as 31.12.2026 where the day comes first: by a day above 12, or the shorter span."""
    if SLASH_DATE.search(body[0]) is None:
        return body
    dates = set(SLASH_DATE.findall("\n".join(body)))
    spans: list[tuple[timedelta, bool]] = []
    for day_at in (1, 0):  # month first is the usual one
        try:
            days = [datetime(int(date[2]), int(date[1 - day_at]), int(date[day_at])) for date in dates]
        except ValueError:
            continue
        spans.append((max(days) - min(days), day_at == 0))
    if not spans or not min(spans)[1]:
        return body
    return [SLASH_DATE.sub(r"\1.\2.\3", line) for line in body]


def _find_table(source: str, lines: list[str], is_delimited: bool) -> tuple[str, int]:
    """Return the delimiter and the index of the first line that is a row of numbers."""
    for k, line in enumerate(lines[:PREAMBLE_LIMIT]):
        for delimiter in DELIMITERS:
            tokens = line.split(delimiter)
            if len(tokens) > MOST_COLUMNS:
                many = Message("too-many-columns", columns=len(tokens), most=MOST_COLUMNS)
                raise TableUnreadable(source, Message("row-unreadable", row=k + 1, error=many))
            values = [_number(token) for token in tokens]
            if len(tokens) >= 2 and None not in values and any(value == value for value in values):
                return delimiter, _with_broken_rows(lines, k, delimiter)
    for k in range(1, min(len(lines), PREAMBLE_LIMIT)):
        for delimiter in DELIMITERS:
            if _is_row_with_words(lines, k, delimiter):
                return delimiter, k
    last = min(len(lines), PREAMBLE_LIMIT)
    if last == 1 and is_delimited:  # and not a sentence
        raise TableUnreadable(source, Message("only-names", line=repr(lines[0][:60])))
    raise TableUnreadable(source, Message("no-row-of-numbers", last=last, line=repr(lines[last - 1][:60])))


def _has_decimal_commas(line: str) -> bool:
    between = line.count(";") + line.count("\t")
    return between > 0 and between + 1 >= line.count(",") and DECIMAL_COMMA.search(line) is not None


def _without_quotes(source: str, lines: list[str]) -> list[str]:
    """Return lines without the quotes of their fields; a delimiter within quotes becomes a space."""
    if not any(line.count('"') >= 2 and any(mark in part for part in line.split('"')[1::2] for mark in DELIMITERS)
               for line in lines):  # fmt: skip
        return lines
    delimiter = max(DELIMITERS, key=lambda delimiter: max(line.count(delimiter) for line in lines[-20:]))
    rows = csv.reader(lines, delimiter=delimiter)
    try:
        return [delimiter.join(field.strip().replace(delimiter, " ") for field in row) for row in rows]
    except csv.Error as error:
        where = Message("row-unreadable", row=rows.line_num, error=str(error))
        raise TableUnreadable(source, where) from error


def _is_row_with_words(lines: list[str], k: int, delimiter: str) -> bool:
    """Return whether a row, and those after it, hold numbers in the same columns and words in the same others."""
    kinds = []
    for line in lines[k : k + ROWS_ALIKE]:
        values = [_number(token) for token in line.split(delimiter)]
        kinds.append(tuple(value is not None for value in values))
    above = lines[k - 1].split(delimiter)
    return sum(kinds[0]) >= 2 and len(set(kinds)) == 1 and len(above) == len(kinds[0])


def _without_empty_ends(lines: list[str]) -> list[str]:
    """Return lines without the delimiters behind the last column that holds anything in any of them."""
    delimiter = max(DELIMITERS, key=lambda mark: sum(line.count(mark) for line in lines[-ENDS_COMPARED:]))
    width = Counter(line.count(delimiter) for line in lines[-ENDS_COMPARED:]).most_common(1)[0][0]
    used = max(line.rstrip(delimiter).count(delimiter) for line in lines)
    after = delimiter * (width - used) if width < MOST_COLUMNS else ""
    return [line.removesuffix(after) for line in lines] if after else lines


def _with_broken_rows(lines: list[str], start: int, delimiter: str) -> int:
    """Return where the table begins: rows above `start` of which only some fields are numbers belong to it."""
    width = len(lines[start].split(delimiter))
    while start > 0:
        tokens = lines[start - 1].split(delimiter)
        values = [_number(token) for token in tokens]
        if len(tokens) != width or not any(value is not None and value == value for value in values):
            break
        start -= 1
    return start


def _number(token: str) -> float | None:
    """Return the number a token holds, NaN for a missing one, a time stamp in seconds, None for a word."""
    token = token.strip(' \t"')
    if token.lower() in MISSING:
        return float("nan")
    try:
        return float(token)
    except ValueError:
        pass
    return _stamp_s(token) if token[:1].isdigit() else None


def _needed(token: str) -> float:
    """Return the number a token holds.

    Raises:
        ValueError: it is a word.
    """
    value = _number(token)
    if value is None:
        raise ValueError(token)
    return value


def _is_stamp(token: str) -> bool:
    token = token.strip(' \t"')
    return ":" in token and _stamp_s(token) is not None


def _stamp_s(token: str) -> float | None:
    """Return a date with its time, or hours, minutes and seconds, in seconds; None for something else.

    2026-05-01T12:00:00, 2026/05/01 12:00:00, 01.05.2026 12:00:00 (day first), 05/01/2026 12:00:00 (month first, as
    long as it can be one), 01-May-26 12:00:00, 12:00:00.5, 2d 12:00:00; with AM or PM behind it, too.
    """
    half = HALF_DAY.fullmatch(token)
    if half is not None:
        before, hours, rest, letter = half.groups()
        token = f"{before}{int(hours) % 12 + (12 if letter in 'pP' else 0):02d}{rest}"
    clock = CLOCK.fullmatch(token)
    if clock is not None:
        days, hours, minutes, seconds = clock.groups()
        return 86400.0 * float(days or 0) + 3600.0 * float(hours) + 60.0 * float(minutes) + float(seconds or 0)
    named = MONTH_BY_NAME.match(token)
    if named is not None and named[2] in MONTHS:
        year = named[3] if len(named[3]) == 4 else f"20{named[3]}"
        token = f"{year}-{MONTHS.index(named[2]) + 1:02d}-{int(named[1]):02d}{token[named.end() :]}"
    date = DATE.match(token)
    if date is not None:
        first, separator, second, year = date.groups()
        day, month = (second, first) if separator == "/" and int(first) <= 12 else (first, second)
        token = f"{year}-{int(month):02d}-{int(day):02d}{token[date.end() :]}"
    try:
        return datetime.fromisoformat(token.replace("/", "-", 2)).timestamp()
    except (ValueError, OverflowError):
        return None


def _header_above(lines: list[str], start: int, delimiter: str) -> tuple[list[str] | None, int]:
    """Return the names above the first row of numbers, None where there are none, and the lines they take up."""
    width = len(lines[start].split(delimiter))
    above = [
        [token.strip().strip('"~') for token in line.split(delimiter)] for line in lines[max(start - 2, 0) : start]
    ]
    above = [tokens[:-1] if len(tokens) == width + 1 and not tokens[-1] else tokens for tokens in above]
    above = [tokens for tokens in above if len(tokens) == width]
    if not above:
        return None, 0
    if len(above) == 2 and all(is_unit(token.strip("[]() ")) for token in above[1] if token):
        return [f"{name} [{unit.strip('[]() ')}]" if unit else name for name, unit in zip(*above, strict=True)], 2
    return above[-1], 1


def _numbers(
    source: str,
    body: list[str],
    numbers: list[int],
    delimiter: str,
    width: int,
    notes: list[Message],
    on_read: OnRows,
) -> list[FloatArray]:
    text = "\n".join(body)
    empty = delimiter * 2
    while empty in text:
        text = text.replace(empty, f"{delimiter}nan{delimiter}")
    text = text.replace(f"{delimiter}\n", f"{delimiter}nan\n").replace(f"\n{delimiter}", f"\nnan{delimiter}")
    text = f"nan{text}" if text.startswith(delimiter) else text
    text = f"{text}nan" if text.endswith(delimiter) else text
    first = [tokens for line in body[:ROWS_ALIKE] if len(tokens := line.split(delimiter)) == width]
    numeric = [k for k in range(width) if not all(_number(tokens[k]) is None for tokens in first)]
    if len(numeric) < width and any(line.count(delimiter) != width - 1 for line in body):
        return _numbers_row_by_row(source, body, numbers, delimiter, width, notes, on_read)
    stamps: dict[int | str, Callable[[str], float]] = {
        k: _needed for k in numeric if any(_is_stamp(tokens[k]) for tokens in first)
    }
    try:
        table = np.loadtxt(
            _with_progress(StringIO(text), len(body), on_read),
            delimiter=delimiter,
            ndmin=2,
            comments=None,
            usecols=numeric,
            converters=stamps or None,
        )
    except ValueError:
        return _numbers_row_by_row(source, body, numbers, delimiter, width, notes, on_read)
    columns = [np.full(len(body), np.nan)] * width
    for k, values in zip(numeric, table.T, strict=True):
        columns[k] = values
    return columns


def _with_progress(rows: Iterable[T], of: int, on_read: OnRows) -> Iterator[T]:
    """The rows, with progress."""
    for k, row in enumerate(rows):
        if k % _PROGRESS_EVERY == 0:
            on_read(k, of)
        yield row


def _numbers_row_by_row(
    source: str,
    body: list[str],
    numbers: list[int],
    delimiter: str,
    width: int,
    notes: list[Message],
    on_read: OnRows,
) -> list[FloatArray]:
    tokens = [line.split(delimiter) for line in body]
    whole = [k for k, row in enumerate(tokens) if len(row) == width]
    rows = [[_number(token) for token in tokens[k]] for k in _with_progress(whole, len(whole), on_read)]
    is_word = np.array([[value is None for value in values] for values in rows])
    holds_words = is_word.mean(axis=0) > 0.5
    if np.count_nonzero(~holds_words) < 2:
        raise TableUnreadable(source, Message("no-two-columns", width=width, delimiter=repr(delimiter)))
    bad = BadRows()
    spoilt = is_word & ~holds_words
    wrong = {k: tokens[k][int(np.argmax(words))] for k, words in zip(whole, spoilt, strict=True) if words.any()}
    for k, row in enumerate(tokens):
        number = numbers[k] if numbers else None
        if len(row) != width:
            bad.add(number, Message("not-so-many-columns", columns=len(row), width=width))
        elif k in wrong:
            bad.add(number, Message("no-number", text=repr(wrong[k].strip()[:20])))
    if bad.count > REFUSED_SHARE * len(body):
        raise TableUnreadable(
            source,
            Message(
                "rows-broken",
                broken=bad.count,
                rows=len(body),
                width=width,
                delimiter=repr(delimiter),
                first=bad.summary(),
            ),
        )
    if bad.count:
        note = Message("rows-not-numbers", rows=bad.count, width=width, first=bad.summary())
        notes.append(bad.warned(note, len(body)))
    filled = [[float("nan") if value is None else value for value in values] for values in rows]
    return list(np.array(filled, dtype=np.float64).T)
