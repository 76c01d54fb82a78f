"""The terminal: tables that fit it, colours where they are wanted, progress; numbers of a command line."""

import argparse
import os
import re
import shutil
import sys
import time
from collections.abc import Callable, Sequence
from typing import Self, TextIO

BOLD, RED, GREEN = "1", "31", "32"
_GAP = 2
_LEAST = 4  # characters of a column that is shortened
_OBEYED = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")  # not: tab, new line
_MODERN = ("WT_SESSION", "ANSICON", "TERM")  # one of them is set where a Windows console understands colours


def coloured(text: str, colour: str, stream: TextIO | None = None) -> str:
    """Return text in a colour where the stream is a terminal that has them and NO_COLOR is not set."""
    stream = sys.stdout if stream is None else stream
    is_plain = os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb" or not stream.isatty()
    if is_plain or (os.name == "nt" and not any(name in os.environ for name in _MODERN)):
        return text
    return f"\x1b[{colour}m{text}\x1b[0m"


def printable(text: str) -> str:
    """Return text without what a terminal would obey: in a name of a foreign file, in bytes of another program.

    Control characters, those that turn the direction of writing, and halves of characters become `\ufffd`.
    """
    return _OBEYED.sub("\ufffd", text)


def print_table(heads: Sequence[str], rows: Sequence[Sequence[str]], aligned: str = "") -> None:
    """Print rows under their heads; on a terminal no wider than it is.

    Args:
        heads: of the columns; none: no line above the rows.
        rows: one text a column.
        aligned: a character a column: `<` text, shortened with … where the terminal is narrow; `>` a number, never.
            Without it, all are texts.
    """
    shown = [*([heads] if heads else []), *([" ".join(printable(text).split("\n")) for text in row] for row in rows)]
    if not shown:
        return
    aligned = aligned or "<" * len(shown[0])
    widths = [max(len(row[k]) for row in shown) for k in range(len(aligned))]
    columns = shutil.get_terminal_size().columns if sys.stdout.isatty() else None
    if columns is not None:
        widths = _fitted(widths, aligned, columns)
    for k, row in enumerate(shown):
        texts = [_short(text, width) for text, width in zip(row, widths, strict=True)]
        cells = (f"{text:{side}{width}}" for text, side, width in zip(texts, aligned, widths, strict=True))
        line = _short((" " * _GAP).join(cells).rstrip(), columns or sys.maxsize)
        print(coloured(line, BOLD) if heads and k == 0 else line)


def _fitted(widths: Sequence[int], aligned: str, columns: int) -> list[int]:
    """Take from the widest text until the line fits, or no text is left to take from."""
    fitted = list(widths)
    beyond = sum(fitted) + _GAP * (len(fitted) - 1) - columns
    while beyond > 0:
        texts = [k for k, side in enumerate(aligned) if side == "<" and fitted[k] > _LEAST]
        if not texts:
            break
        fitted[max(texts, key=lambda k: fitted[k])] -= 1
        beyond -= 1
    return fitted


def _short(text: str, width: int) -> str:
    return text if len(text) <= width else text[: max(width - 1, 0)] + "…"


SHOWN_AFTER_S = 2.0
EVERY_S = 0.2
_PARTS = 1000  # steps of one job in the progress of several


class Progress:
    """Progress of a job, in a line of standard error that is written over and taken away at the end.

    Per cent and the time left, as soon as it takes longer than a moment; nothing where there is no terminal.
    """

    def __init__(self, what: str = "", *, shows: bool = True) -> None:
        """Begin to count the time of the job.

        Args:
            what: stands before the numbers.
            shows: False: nothing at all, for a job that nobody waits for.
        """
        self._what = f"{what} " if what else ""
        self._shows = shows and sys.stderr.isatty()
        self._started_s = time.monotonic()
        self._shown_s = self._started_s + SHOWN_AFTER_S - EVERY_S
        self._is_shown = False

    def __call__(self, done: int, of: int) -> None:
        """Show that so many of so many parts are done."""
        now_s = time.monotonic()
        if not self._shows or now_s < self._shown_s + EVERY_S:
            return
        self._shown_s, self._is_shown = now_s, True
        left_s = (now_s - self._started_s) * (of - done) / max(done, 1)
        text = f"{self._what}{100 * done / max(of, 1):5.1f} %, {time_left(left_s)} left"
        print(f"\r{text:<60}", end="", file=sys.stderr, flush=True)

    def share(self, k: int, n: int) -> Callable[[int, int], None]:
        """Return what shows the progress of job `k` of `n` as that of all."""
        return lambda done, of: self(_PARTS * k + _PARTS * done // max(of, 1), _PARTS * n)

    def end(self) -> None:
        """Leave the line free for what follows."""
        if self._is_shown:
            print(f"\r{'':<60}\r", end="", file=sys.stderr, flush=True)
            self._is_shown = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()


def time_left(seconds: float) -> str:
    """Return a duration as a person says it: 8 s, 3 min, 2 h 5 min."""
    if seconds < 60.0:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"


def between(low: float, high: float, meaning: str) -> Callable[[str], float]:
    """Return argparse's converter for a number within limits; the refusal names them and what is counted."""

    def convert(text: str) -> float:
        try:
            value = float(text.removesuffix("%") if meaning == "percent" else text)
        except ValueError:
            value = float("nan")
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text!r} is not {low:g} to {high:g} {meaning}")
        return value

    return convert


def segments(text: str) -> tuple[int, int]:
    """Read packs in series x cells in series in each, as `8x12`."""
    from app.battery.fields import MOST_CELLS  # here: numpy comes with it

    match = re.fullmatch(r"(\d{1,4})[xX](\d{1,4})", text)
    n, in_series = (int(part) for part in match.groups()) if match else (0, 0)
    if not 1 <= n * in_series <= MOST_CELLS:
        raise argparse.ArgumentTypeError(f"{text!r} is not SEGMENTSxCELLS, as 8x12, with 1 to {MOST_CELLS} cells")
    return n, in_series


def fraction(text: str) -> float:
    """Read 0 to 1, or per cent with their sign."""
    try:
        value = float(text.rstrip("%")) / (100.0 if text.endswith("%") else 1.0)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number") from None
    if not 0.0 <= value <= 1.0:
        raise argparse.ArgumentTypeError(f"{text} is not between 0 and 1; write percent with a % sign")
    return value
