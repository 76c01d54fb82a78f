"""What an export calls its signals: as this program does, or in words that every tool takes as a name."""

import re
from collections.abc import Sequence
from itertools import accumulate

from app.sessions.export.formats import Names
from app.sessions.storage.signals import Signal, Signals

_INDEX = re.compile(r"\[(\d+)\]")
_NOT_OF_CELLS = "sensor"  # its elements are sensors, also where there are as many as cells


def export_name(signal: Signal, names: Names, signals: Signals, segments: Sequence[int]) -> str:
    """Return a signal's name without its unit.

    Args:
        signal: of `signals`, or one that a table adds.
        names: `index`: `v[36]`, counted from 0; `number`: `v_037`, from 1; `pack`: `pack4_cell1_v`, from 1, and as
            `number` what is not of one cell.
        signals: of the session.
        segments: cells of each pack.
    """
    if names == "index":
        return signal.name
    if names == "pack" and _is_of_a_cell(signal, signals, sum(segments)):
        ends = list(accumulate(segments))
        pack = next(k for k, end in enumerate(ends) if signal.element < end)
        cell = signal.element - ends[pack] + segments[pack]
        return f"pack{pack + 1}_cell{cell + 1}_{_word(signal.field)}"
    return _word(_INDEX.sub(lambda found: f"_{int(found[1]) + 1:03d}", signal.name))


def _is_of_a_cell(signal: Signal, signals: Signals, n_cells: int) -> bool:
    is_one_of_many = signal.field in signals.order and signal.name != signal.field
    return is_one_of_many and signal.field != _NOT_OF_CELLS and signals.of_field(signal.field)[1] == n_cells


def _word(name: str) -> str:
    return name.replace(".", "_")


def column_name(name: str, unit: str) -> str:
    """Return a name with its unit: `v[36] (V)`."""
    return name if unit in ("", "1") else f"{name} ({unit})"
