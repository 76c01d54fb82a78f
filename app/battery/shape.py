"""The shape of a battery: the number of packs, and of cells in each."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class Shape:
    """Packs of equal size; a cell's index counts through the packs in order, from 0."""

    n_segments: int
    cells_per_segment: int

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return self.n_segments * self.cells_per_segment


TEAM_PROFILE: Final = "team"  # the bundled profile of the team's own battery
TEAM: Final = Shape(n_segments=8, cells_per_segment=12)  # the team's battery, as in the master's memory map
N_PACKS: Final = TEAM.n_segments
CELLS_PER_PACK: Final = TEAM.cells_per_segment
N_CELLS: Final = TEAM.n_cells
