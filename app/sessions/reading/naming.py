"""What is said of a session names the cells of its own battery."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Concatenate, ParamSpec, TypeVar

from app.sessions.reading.reader import SessionFile
from app.words import naming_cells

_More = ParamSpec("_More")
_Result = TypeVar("_Result")


def in_its_words(
    analyse: Callable[Concatenate[SessionFile, _More], _Result],
) -> Callable[Concatenate[SessionFile, _More], _Result]:
    """Let messages that are made within name packs and cells of the session's battery."""

    @wraps(analyse)
    def named(session: SessionFile, /, *args: _More.args, **kwargs: _More.kwargs) -> _Result:
        with naming_cells(session.battery.segments):
            return analyse(session, *args, **kwargs)

    return named
