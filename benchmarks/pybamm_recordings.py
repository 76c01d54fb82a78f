"""Makes what `benchmarks.accuracy` reads besides the shared data: `python -m benchmarks.pybamm_recordings`.

Two cells that take no part in any tuning: slow test, pulses, two races, and the power that each holds at moments of the
second. Single particles with electrolyte and lumped heat, some minutes in all. Needs the extra `voltwall[pybamm]`. What
is in the folder already is kept.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from app.estimation.recording.cell_recording import Recording
from tests.numeric.pybamm_cells import CELLS, held_power, pulse_test, race, save, slow_test

KEEP: Final = Path("../pybamm")
OWN: Final = ("Ecker2015", "Ai2020")  # NMC and LCO
RACE, START_SOC, START_DEGC = 2, 0.95, 20.0
MOMENTS_S: Final = np.arange(60.0, 1500.0, 80.0)
HORIZONS_S: Final = (10.0, 30.0)


def work_of(name: str) -> dict[str, Callable[[], Recording]]:
    """Return what makes each recording of a cell."""
    cell = CELLS[name]
    return {
        "c30": lambda: slow_test(cell, False),
        "hppc": lambda: pulse_test(cell, 25.0, False),
        "hppc40": lambda: pulse_test(cell, 40.0, False),
        "train": lambda: race(cell, 1, START_SOC, START_DEGC, False),
        "race": lambda: race(cell, RACE, START_SOC, START_DEGC, False),
    }


def missing(folder: Path) -> list[str]:
    """Return the files that are not there."""
    files = [file for name in OWN for file in (*(f"{name}_{of}.csv.gz" for of in work_of(name)), f"{name}_power.csv")]
    return [file for file in files if not (folder / file).is_file()]


def main() -> None:
    """Make what is missing."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keep", type=Path, default=KEEP, help="folder of the recordings (default: %(default)s)")
    args = parser.parse_args()
    args.keep.mkdir(parents=True, exist_ok=True)
    for file in missing(args.keep):
        print(file, flush=True)
        name, _, of = file.removesuffix(".gz").removesuffix(".csv").partition("_")
        if of == "power":
            held = held_power(CELLS[name], RACE, START_SOC, START_DEGC, False, MOMENTS_S, HORIZONS_S)
            np.savetxt(
                args.keep / file, held, "%.6g", ",", comments="", header="time_s,v_min_v,power_10s_w,power_30s_w"
            )
        else:
            save(work_of(name)[of](), args.keep / file)


if __name__ == "__main__":
    main()
