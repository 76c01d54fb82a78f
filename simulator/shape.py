"""The shape of the accumulator: the number of packs, and of cells in each; cells count from 0 through the packs."""

from bisect import bisect_right
from dataclasses import dataclass
from itertools import accumulate

from firmware_protocol.memory_map import CELLS_PER_PACK, N_PACKS
from simulator.errors import InputError


@dataclass(frozen=True, slots=True)
class Shape:
    """Packs (the rules say segments) may differ in size."""

    packs: tuple[int, ...]  # cells of each, >= 1
    is_team: bool = False  # the team's own battery: its master, with a configuration, RS232, EEPROM and isoSPI

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return sum(self.packs)

    @property
    def n_packs(self) -> int:
        """Number of packs."""
        return len(self.packs)

    @property
    def starts(self) -> tuple[int, ...]:
        """Index of the first cell of each pack."""
        return (0, *accumulate(self.packs))[:-1]

    def cells(self, pack: int) -> slice:
        """The cells of a pack, from 0."""
        first = self.starts[pack]
        return slice(first, first + self.packs[pack])

    def place(self, cell: int) -> tuple[int, int]:
        """Return pack and cell as people count, from 1."""
        pack = bisect_right(self.starts, cell) - 1
        return pack + 1, cell - self.starts[pack] + 1

    def cell_index(self, pack: int, cell: int) -> int:
        """Return the index of a cell that people call pack 1.., cell 1...

        Raises:
            InputError: there is no such cell.
        """
        if not 1 <= pack <= self.n_packs:
            raise InputError("pack", f"pack = {pack} is outside 1..{self.n_packs}")
        if not 1 <= cell <= self.packs[pack - 1]:
            raise InputError("cell", f"cell = {cell} is outside 1..{self.packs[pack - 1]} of pack {pack}")
        return self.starts[pack - 1] + cell - 1


TEAM = Shape((CELLS_PER_PACK,) * N_PACKS, is_team=True)
