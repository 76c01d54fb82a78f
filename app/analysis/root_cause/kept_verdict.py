"""The verdict on an incident as it is kept with its session, in the notes: all that were made, the newest last."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from math import isfinite
from pathlib import Path
from typing import Any, Final

from app.analysis.incidents import Trigger, incident_id, main_trigger
from app.analysis.root_cause.judge import Cause, cause_from_json
from app.sessions.reading.reader import SessionFile
from app.sessions.reading.session_info import write_note

MOST_KEPT: Final = 20  # verdicts on one incident
_NUMBERS: Final = ("at", "since", "confidence", "size", "low", "high", "judged")
_PLACES: Final = ("cell", "pack")


def kept_verdicts(session: SessionFile, group: Sequence[Trigger]) -> list[Cause]:
    """Return the verdicts on an incident, the newest last; none where another program wrote something else there."""
    rows = session.note(_key(group))
    try:
        return [_sound(row, session.battery.n_cells) for row in rows or []]
    except (KeyError, TypeError, ValueError, AttributeError):
        return []


def keep_verdict(
    path: Path, group: Sequence[Trigger], verdict: Cause, before: Sequence[Cause], *, t_wall_ns: int
) -> None:
    """Keep a verdict on an incident with its session, after those of before.

    Raises:
        SessionError: the file cannot take it.
    """
    rows = [asdict(kept) for kept in (*before, verdict)][-MOST_KEPT:]
    write_note(path, _key(group), rows, t_wall_ns=t_wall_ns, who=None)


def _key(group: Sequence[Trigger]) -> str:
    return f"verdict {incident_id(main_trigger(group))}"


def _sound(row: dict[str, Any], n_cells: int) -> Cause:
    """Return a kept verdict; the file may come from elsewhere.

    Raises:
        KeyError, TypeError, ValueError, AttributeError: it is none.
    """
    verdict = cause_from_json(row)
    parts = (row, *row["others"])
    is_sound = (
        verdict is not None
        and all(_is_number(part.get(name)) for part in parts for name in _NUMBERS)
        and all(_is_place(part.get(name), n_cells) for part in parts for name in _PLACES)
        and all(isinstance(text, str) for text in (*(part["code"] for part in parts), verdict.unit))
        and isinstance(verdict.revised, bool)
    )
    if verdict is None or not is_sound:
        raise ValueError("no verdict")
    return verdict


def _is_number(value: object) -> bool:
    return value is None or (isinstance(value, int | float) and isfinite(value))


def _is_place(value: object, n_cells: int) -> bool:
    return value is None or (isinstance(value, int) and 0 <= value < n_cells)
