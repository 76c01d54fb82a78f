"""Tables that fit the terminal, and colours where somebody looks and wants them."""

import os
import re
import shutil
import sys
from collections.abc import Sequence
from typing import TextIO

BOLD, RED, GREEN, YELLOW = "1", "31", "32", "33"
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
