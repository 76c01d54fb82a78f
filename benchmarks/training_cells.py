"""The hard cases on cells and drives that numbers were chosen on: `python -m benchmarks.training_cells --keep FOLDER`.

Drives in the manner of `held_out.py`, with other cells, seeds and starts. Columns as in `hard_cases.py`.
"""

from __future__ import annotations

from benchmarks.driven_cells import Drives, main
from tests.numeric.pybamm_cells import Cell

CELLS = {
    cell.name: (cell, False)
    for cell in (
        Cell("Mohtat2020", 4.96624, 5.0, 1.3),
        Cell("Chen2020", 5.14727, 4.0, 1.1),
        Cell("Ramadass2004", 1.49944, 3.0, 1.0, is_isothermal=True),
    )
}
DRIVES = Drives(race_seed=7002, road_seeds=(11, 12), race=(0.95, 24.0), road=(0.92, 24.0), cold=(0.94, 7.0))

if __name__ == "__main__":
    main(__doc__, CELLS, DRIVES, is_training=True)
