"""Sum and mean of the cells as the master sent them, without those that hold not all cells.

The firmware sums and averages the cells that it has; sum over mean is how many these were.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial

import numpy as np

from app.sessions.reading.blocks import Block, BlockColumn, ElementArray
from app.sessions.storage.streams import CountArray
from firmware_protocol.memory_map import FIELDS, V_MISSING

SUM, MEAN = "v_tot", "v_avg"
_SUM_OF_MEANS = FIELDS[SUM].scale / FIELDS[MEAN].scale


def with_whole_totals(
    read: Callable[[Mapping[str, ElementArray]], Iterator[Block]], wanted: Mapping[str, ElementArray], n_cells: int
) -> Iterator[Block]:
    """Yield the blocks that `read` gives of the wanted elements; a sum or mean of fewer than `n_cells` is missing."""
    if SUM not in wanted and MEAN not in wanted:
        yield from read(wanted)
        return
    for block in read({SUM: np.zeros(1, np.intp), MEAN: np.zeros(1, np.intp), **wanted}):
        columns = tuple(_whole(column, block.columns, n_cells) for column in block.columns if column.field in wanted)
        if columns:
            yield Block(columns)


def _whole(column: BlockColumn, columns: Sequence[BlockColumn], n_cells: int) -> BlockColumn:
    if column.field not in (SUM, MEAN):
        return column
    other = SUM if column.field == MEAN else MEAN
    for candidate in columns:
        if candidate.field == other and candidate.track is column.track:  # same instants
            decode = partial(_counts, column, candidate, n_cells)
            return BlockColumn(column.field, column.elements, column.track, decode)
    return column


def _counts(column: BlockColumn, other: BlockColumn, n_cells: int) -> CountArray:
    total, mean = (column, other) if column.field == SUM else (other, column)
    measured = total.counts * _SUM_OF_MEANS / np.maximum(mean.counts, 1)
    is_partial = (mean.counts != V_MISSING) & (measured < n_cells - 0.5)
    return np.where(is_partial, column.counts.dtype.type(V_MISSING), column.counts)
