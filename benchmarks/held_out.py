"""The hard cases on cells and drives that nothing was tuned on: `python -m benchmarks.held_out --keep FOLDER`.

Parameter sets of PyBaMM that took no part in choosing a number of the filters. Columns as in `hard_cases.py`.
"""

from __future__ import annotations

from benchmarks.driven_cells import Drives, main
from tests.numeric.pybamm_cells import Cell

CELLS = {
    cell.name: (cell, full)
    for cell, full in (
        (Cell("Prada2013", 2.2915, 6.0, 1.3, is_isothermal=True), True),
        (Cell("Marquis2019", 0.8722, 3.0, 1.0), False),
        (Cell("Ecker2015", 0.1710, 5.0, 1.2), False),
        (Cell("NCA_Kim2011", 0.4830, 4.0, 1.0), False),
        (Cell("Ai2020", 2.4649, 4.0, 1.0), False),
        (Cell("ORegan2022", 5.0222, 4.0, 1.2), False),
        (Cell("OKane2022", 5.1056, 4.0, 1.2), True),
    )
}
DRIVES = Drives(race_seed=7001, road_seeds=(1, 2), race=(0.93, 22.0), road=(0.88, 22.0), cold=(0.9, 5.0))

if __name__ == "__main__":
    main(__doc__, CELLS, DRIVES, is_training=False)
