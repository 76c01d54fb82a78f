"""Two nodes that send the same CAN id: a cell's voltage then reads two values in turn, and neither can be trusted.

On a bus every id has one sender. Where two slaves were given the same address, or a second BMS was plugged in, each
frame replaces the one before it. Time and bus do not tell the senders apart; that a voltage goes to and fro, again and
again, while the other cells do not, does.
"""

from typing import Final

import numpy as np

from app.estimation.arrays import BoolArray, FloatArray, IntArray
from app.sources.dbc.battery_decoder import ChannelValues
from app.telemetry import Event
from app.words import Cell, Message, Quantity

LEAST_JUMP_V: Final = 0.010  # above the noise of a cell monitor
JUMP_RATIO: Final = 4.0  # the jump to the value before, over the change since the one before that
FOUND: Final = 10  # jumps to and fro in a row
MOST: Final = 20  # so it takes at most ten other values until the cells are trusted again
LOST: Final = 2  # taken off for a value that does not jump: two senders now and then swap their order
MOST_SHARE: Final = 0.5  # share of all cells; where more alternate, it is the current


class TwoSenders:
    """Finds the cells that read two values in turn. Called from one thread."""

    def __init__(self, n_cells: int) -> None:
        self._newest_v = np.full(n_cells, np.nan)
        self._before_v = np.full(n_cells, np.nan)
        self._jumps = np.zeros(n_cells, np.int64)
        self.cells: BoolArray = np.zeros(n_cells, np.bool_)
        self._unreported: BoolArray = self.cells.copy()

    def take(self, voltages: ChannelValues) -> None:
        """Take voltages in the order of their frames; `cells` are then those that read two values in turn."""
        is_finite = np.isfinite(voltages.value)
        index, value = voltages.index[is_finite], voltages.value[is_finite]
        while len(index):
            cells, first = np.unique(index, return_index=True)
            self._take_one_each(cells, value[first])
            index, value = np.delete(index, first), np.delete(value, first)
        before = self.cells
        is_jumping = (self._jumps >= FOUND) | (before & (self._jumps > 0))
        self.cells = is_jumping & (is_jumping.mean() <= MOST_SHARE)
        self._unreported = (self._unreported | ~before) & self.cells

    def events(self, t_wall_ns: int) -> tuple[Event, ...]:
        """Return an event of the cells that were found since the last call."""
        cells = np.flatnonzero(self._unreported).tolist()
        if not cells:
            return ()
        self._unreported = np.zeros_like(self.cells)
        low, high = sorted((float(self._before_v[cells[0]]), float(self._newest_v[cells[0]])))
        message = Message(
            "two-senders",
            n=len(cells),
            first=Cell(cells[0]),
            last=Cell(cells[-1]),
            low=Quantity(low, "V", 3),
            high=Quantity(high, "V", 3),
        )
        return (Event(t_wall_ns, "warning", message.code, message, cell=cells[0]),)

    def _take_one_each(self, cells: IntArray, value: FloatArray) -> None:
        jump_v = np.abs(value - self._newest_v[cells])
        change_v = np.abs(value - self._before_v[cells])
        jumps = (jump_v > LEAST_JUMP_V) & (jump_v > JUMP_RATIO * change_v)  # False while one is unknown
        self._jumps[cells] = np.clip(self._jumps[cells] + np.where(jumps, 1, -LOST), 0, MOST)
        self._before_v[cells], self._newest_v[cells] = self._newest_v[cells], value
