"""The shape of a battery: the number of packs, and of cells in each."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class Shape:
    """Packs of equal size; a cell's index counts through the packs in order, from 0."""

    n_packs: int
    cells_per_pack: int

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return self.n_packs * self.cells_per_pack


TEAM_PROFILE: Final = "team"  # the bundled profile of the team's own battery
TEAM: Final = Shape(n_packs=8, cells_per_pack=12)  # the team's battery, as in the master's memory map
N_PACKS: Final = TEAM.n_packs
CELLS_PER_PACK: Final = TEAM.cells_per_pack
N_CELLS: Final = TEAM.n_cells
