"""Test rigs that tell the size of the current in one column and its direction by a word in another, as Maccor does."""

import re
from collections.abc import Mapping

import numpy as np

from app.estimation.arrays import FloatArray

_NAMES = {"state", "status", "md", "mode", "steptype", "stepname", "step", "command", "instructionname"}
_DISCHARGING = re.compile(r"d|dis\b.*|dch\w*|.*dchg\w*|.*discharg\w*", re.IGNORECASE)
_CHARGING = re.compile(r"c|cha|chg|.*\bchg|.*_chg|.*charg\w*", re.IGNORECASE)


def tells_state(name: str) -> bool:
    """Return whether a column of this name may say what the cell does."""
    return re.sub(r"[^a-z]", "", name.lower()) in _NAMES


def state_of(word: str) -> float:
    """Return -1 for a word that means discharge, 1 for charge, 0 for another."""
    word = word.strip(' \t"')
    if _DISCHARGING.fullmatch(word):
        return -1.0
    return 1.0 if _CHARGING.fullmatch(word) else 0.0


def signed(current: FloatArray, columns: Mapping[str, FloatArray]) -> tuple[FloatArray, str | None]:
    """Return a (n,) current, positive on discharge, whose sign another column tells; None: it has its own sign.

    Args:
        current: as it is in the table.
        columns: of the table; one of words has -1, 0 and 1.

    Returns:
        The current, and the name of the column that told its direction.
    """
    known = current[np.isfinite(current)]
    if not len(known) or np.min(known) < 0.0:
        return current, None
    for name, values in columns.items():
        if tells_state(name) and {-1.0, 1.0} <= set(np.unique(values[np.isfinite(values)])) <= {-1.0, 0.0, 1.0}:
            return np.where(values == 0.0, current, -values * current), name
    return current, None
