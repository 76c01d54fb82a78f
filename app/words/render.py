"""Turn a message into text with the table of one language. `frontend/src/words/render.ts` does the same on the page.

A template holds `{name}` for each argument. Where a number decides between two wordings, the template is an object
with `one` and `other`, chosen by the argument `n`; without it there is one. A cell is named by the battery that
whoever renders has.
"""

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from decimal import ROUND_HALF_UP, Context, Decimal
from functools import cache
from importlib.resources import files
from itertools import accumulate

from app.words.message import Argument, Cell, Message, Pack, Quantity, RenderedMessage, Text, coded, json_args

Template = str | Mapping[str, str]
UNITS = {"degC": "°C", "mohm": "mΩ", "ohm": "Ω", "uohm": "µΩ"}
_NAME = re.compile(r"\{(\w+)\}")
_SIX_DIGITS = Context(prec=6, rounding=ROUND_HALF_UP)


def languages() -> list[str]:
    """Return the languages that have a folder here."""
    return sorted(folder.name for folder in files(__package__).iterdir() if (folder / "codes.json").is_file())


@cache
def table(language: str) -> dict[str, Template]:
    """Return the templates of a language by code.

    Raises:
        FileNotFoundError: there is no such language.
    """
    templates: dict[str, Template] = json.loads(files(__package__).joinpath(language, "codes.json").read_text("utf-8"))
    return templates


def render(message: Text, segments: Sequence[int] = (), language: str = "en") -> str:
    """Return a message as text; one whose code the table lacks, of a newer version, is its code.

    Args:
        message: what is rendered.
        segments: cells of each pack of its battery; empty: not known, a cell is named by its number alone.
        language: of the table.
    """
    if isinstance(message, str):
        return message
    template = table(language).get(message.code, message.code)
    if not isinstance(template, str):
        template = template["one" if message.args.get("n", 1) == 1 else "other"]
    return _NAME.sub(
        lambda match: _text(message.args[match[1]], segments, language) if match[1] in message.args else match[0],
        template,
    )


def rendered(message: Text, segments: Sequence[int] = ()) -> RenderedMessage:
    """Return a message as it is sent; `segments` as for `render`."""
    sent = coded(message)
    return RenderedMessage(sent.code, json_args(sent), render(sent, segments))


def rendered_or_none(message: Text | None) -> RenderedMessage | None:
    """Return a message as it is sent, None without one."""
    return None if message is None else rendered(message)


def sentence(message: Text, segments: Sequence[int] = ()) -> RenderedMessage:
    """Return a message as it is sent, its English text with a capital letter."""
    sent = rendered(message, segments)
    return replace(sent, text=sent.text[:1].upper() + sent.text[1:])


def place_of(cell: int, segments: Sequence[int]) -> tuple[int, int] | None:
    """Return pack and number in it, both from 1, of a cell's index from 0; None where the battery has no such cell."""
    for pack, (size, end) in enumerate(zip(segments, accumulate(segments), strict=True), 1):
        if cell < end:
            return pack, cell - end + size + 1
    return None


def _text(argument: Argument, segments: Sequence[int], language: str) -> str:
    match argument:
        case Message():
            return render(argument, segments, language)
        case Cell(index):
            place = place_of(index, segments)
            if place is None:
                return render(Message("cell-number", cell=index + 1), (), language)
            return render(Message("cell", pack=place[0], cell=place[1]), (), language)
        case Pack(pack):
            return str(pack + 1)
        case Quantity(value, unit, digits):
            return f"{number(value, digits)} {UNITS.get(unit, unit)}".rstrip()
        case tuple():
            return ", ".join(_text(element, segments, language) for element in argument)
        case str():
            return argument
    return number(argument)


def number(value: float | None, digits: int | None = None) -> str:
    """Return a number in decimals, rounded half away from zero as JavaScript does; a missing one is a dash."""
    if value is None or not math.isfinite(value):
        return "–"
    exact = Decimal(value) + 0  # a negative zero is a zero
    if digits is not None:
        return f"{exact.quantize(Decimal(1).scaleb(-digits), ROUND_HALF_UP):f}"
    if exact == exact.to_integral_value():
        return f"{exact:.0f}"
    text = f"{_SIX_DIGITS.create_decimal(exact):f}"
    return text.rstrip("0").rstrip(".")
