"""A name that is not known, and the known one that was probably meant."""

from collections.abc import Iterable
from difflib import get_close_matches


def closest(name: str, names: Iterable[str]) -> str | None:
    """Return the known name most similar to `name`; None where none is similar."""
    return next(iter(get_close_matches(name, list(names), n=1)), None)


def did_you_mean(name: str, names: Iterable[str]) -> str:
    """Return `, did you mean 'NAME'?` with the closest known name, or an empty text."""
    nearest = closest(name, names)
    return f", did you mean {nearest!r}?" if nearest else ""
