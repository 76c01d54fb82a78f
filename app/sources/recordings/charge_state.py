"""Which way a current flows: by a word in another column, as Maccor tells it, or by what the voltage does meanwhile."""

import re
from collections.abc import Mapping

import numpy as np

from app.estimation.arrays import FloatArray

_NAMES = {
    "state", "status", "md", "mode", "steptype", "stepname", "step", "command", "instructionname",
    "工步类型", "工步名称", "状态", "工作模式",
}  # fmt: skip
_DISCHARGING = re.compile(r"d|dis\b.*|dch\w*|.*dchg\w*|.*discharg\w*|.*放电", re.IGNORECASE)
_CHARGING = re.compile(r"c|cha|chg|.*\bchg|.*_chg|.*charg\w*|.*充电", re.IGNORECASE)
SIGN_EVIDENCE = 0.4  # correlation of voltage and current from which on the sign is told by it
_BLOCKS = 200  # of a test along which the charge counts: a slow one moves less from row to row than its meter tells


def tells_state(name: str) -> bool:
    """Return whether a column of this name may say what the cell does."""
    return re.sub(r"[\W\d_]", "", name.lower()) in _NAMES


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


def charges_positive(current: FloatArray, voltage: FloatArray) -> bool:
    """Return whether the voltage rises with the current, from row to row or along the test: then charging is positive.

    Args:
        current: (n,) as it is in the table.
        voltage: (n,) at the same rows, in any unit.
    """
    known = np.isfinite(current) & np.isfinite(voltage)
    current, voltage = current[known], voltage[known]
    together = _alike(np.diff(current), np.diff(voltage))
    if abs(together) < SIGN_EVIDENCE:
        ends = np.unique(np.linspace(0, len(voltage), _BLOCKS + 1, dtype=np.intp))
        starts = ends[:-1]
        if len(starts) < 2:
            return False
        mean = np.add.reduceat(current, starts) / np.diff(ends)
        together = _alike(mean[:-1], np.diff(voltage[starts]))
    return together > SIGN_EVIDENCE


def _alike(one: FloatArray, other: FloatArray) -> float:
    """How far two (n,) arrays are each other's multiple, -1..1; 0 where one has nothing in it."""
    size = float(np.linalg.norm(one) * np.linalg.norm(other))
    return float(one @ other) / size if size > 0.0 else 0.0
