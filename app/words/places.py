"""Which battery's cells a process, or a piece of work, speaks of: where a cell's index becomes its pack and number."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from itertools import accumulate
from typing import Final

from firmware_protocol.memory_map import CELLS_PER_PACK, N_PACKS

TEAM: Final = (CELLS_PER_PACK,) * N_PACKS  # of messages that name no pack: the team's own

_of_process: list[tuple[int, ...]] = [TEAM]
_of_work: ContextVar[tuple[int, ...] | None] = ContextVar("segments", default=None)


def name_cells_by(segments: Sequence[int]) -> None:
    """From now on cells are those of a battery with these segments, in all threads."""
    _of_process[0] = tuple(segments)


@contextmanager
def naming_cells(segments: Sequence[int]) -> Iterator[None]:
    """Within, in this thread, cells are those of a battery with these segments: that of a session, for one."""
    before = _of_work.set(tuple(segments))
    try:
        yield
    finally:
        _of_work.reset(before)


def place_of(index: int, segments: Sequence[int] | None = None) -> tuple[int, int]:
    """Return pack and cell, both from 1; beyond the last cell packs go on in the size of the last one."""
    known = segments or _of_work.get() or _of_process[0]
    for pack, end in enumerate(accumulate(known), 1):
        if index < end:
            return pack, index - end + known[pack - 1] + 1
    more, cell = divmod(index - sum(known), known[-1])
    return len(known) + more + 1, cell + 1
