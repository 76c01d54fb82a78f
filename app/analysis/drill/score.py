"""What an answer is worth: two points for what failed, one more for where."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from app.analysis.drill.days import CHOICES, Day

FAULT_POINTS, PLACE_POINTS = 2, 1


@dataclass(frozen=True, slots=True)
class Answer:
    """What somebody says failed; pack and cell as people count them."""

    fault: str
    pack: int | None = None
    cell: int | None = None


def most_points(day: Day) -> int:
    """Return what the right answer is worth."""
    return FAULT_POINTS + (PLACE_POINTS if CHOICES[day.fault] != "none" else 0)


def points(day: Day, answer: Answer | None) -> int:
    """Return what an answer is worth; no answer is worth nothing.

    A cell's wire is the one between two cells: the cell above it counts as well.
    """
    if answer is None:
        return 0
    found = FAULT_POINTS if answer.fault == day.fault else 0
    return found + (PLACE_POINTS if _is_there(day, answer) else 0)


def _is_there(day: Day, answer: Answer) -> bool:
    match CHOICES[day.fault]:
        case "none":
            return False
        case "pack":
            return answer.pack == day.pack
        case "cell":
            above = 1 if day.fault == "open-wire" else 0
            cells = {day.cell, (day.cell or 0) + above}
            return answer.pack == day.pack and answer.cell in cells


def total(marks: Sequence[tuple[int, int]]) -> tuple[int, int]:
    """Return the sum of points and of the most that could be had."""
    return sum(got for got, _ in marks), sum(most for _, most in marks)
