"""Turn a message into text with the table of one language. `frontend/src/words/render.ts` does the same on the page.

A template holds `{name}` for each argument. Where a number decides between two wordings, the template is an object
with `one` and `other`, chosen by the argument `n`.
"""

import json
import math
import re
from collections.abc import Mapping
from decimal import ROUND_HALF_UP, Context, Decimal
from functools import cache
from importlib.resources import files

from app.words.message import Argument, Cell, Message, Quantity, Text

Template = str | Mapping[str, str]
UNITS = {"degC": "°C", "mohm": "mΩ", "ohm": "Ω", "uohm": "µΩ"}
_NAME = re.compile(r"\{(\w+)\}")
_SIX_DIGITS = Context(prec=6, rounding=ROUND_HALF_UP)


def languages() -> list[str]:
    """Return the languages that have a folder here."""
    return sorted(folder.name for folder in files(__package__).iterdir() if (folder / "general.json").is_file())


@cache
def table(language: str) -> dict[str, Template]:
    """Return the templates of a language by code, of all its files.

    Raises:
        FileNotFoundError: there is no such language.
    """
    found: dict[str, Template] = {}
    for file in files(__package__).joinpath(language).iterdir():
        if file.name.endswith(".json"):
            found |= json.loads(file.read_text(encoding="utf-8"))
    return found


def render(message: Text, language: str = "en") -> str:
    """Return a message as text; one whose code the table lacks, of a newer version, is its code."""
    if isinstance(message, str):
        return message
    template = table(language).get(message.code, message.code)
    if not isinstance(template, str):
        template = template["one" if message.args.get("n") == 1 else "other"]
    return _NAME.sub(
        lambda found: _text(message.args[found[1]], language) if found[1] in message.args else found[0], template
    )


def _text(argument: Argument, language: str) -> str:
    match argument:
        case Message():
            return render(argument, language)
        case Cell():
            return render(Message("cell", pack=argument.pack, cell=argument.cell), language)
        case Quantity(value, unit, digits):
            return f"{number(value, digits)} {UNITS.get(unit, unit)}".rstrip()
        case tuple():
            return ", ".join(_text(each, language) for each in argument)
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
