"""The whole chain on a cell of pure physics: identified on PyBaMM's tests, judged on its races.

    python -m benchmarks.pybamm_check [--cells Mohtat2020 Ecker2015] [--keep FOLDER] [--full] [--plots docs/images]

Needs the extra `voltwall[pybamm]`. With `--keep` the recordings are written, and read again the next time.
"""

from __future__ import annotations

import argparse
import importlib.util
from collections.abc import Callable
from pathlib import Path

from app.estimation.cell_model.circuit import CellModel
from app.estimation.recording.cell_recording import Recording
from app.sources.recordings.dataset import load_recording
from benchmarks.accuracy import HEADER, N_PINNED, Case, judge_case, print_summary
from benchmarks.sources_plots import draw_physics
from tests.numeric.judgement import Judgement, disturbed, estimate
from tests.numeric.pybamm_cells import CELLS, Cell, pulse_test, race, save, slow_test

DEFAULT_CELLS = ("Mohtat2020", "Ecker2015")


def recordings(cell: Cell, full: bool, keep: Path | None) -> dict[str, Recording]:
    """Return the tests and races of a cell by name, from the folder where they are kept.

    Raises:
        ImportError: one has to be simulated and PyBaMM is not installed.
    """
    work: dict[str, Callable[[], Recording]] = {
        "slow": lambda: slow_test(cell, full),
        "pulses25": lambda: pulse_test(cell, 25.0, full),
        "pulses40": lambda: pulse_test(cell, 40.0, full),
        "train": lambda: race(cell, 1, 0.95, 20.0, full),
        "race2": lambda: race(cell, 2, 0.95, 20.0, full),
        "race3": lambda: race(cell, 3, 0.9, 25.0, full),
    }
    found = {}
    for name, simulated in work.items():
        path = None if keep is None else keep / f"{cell.name}_{name}.csv.gz"
        if path is not None and path.exists():
            found[name] = load_recording(path)
            continue
        found[name] = simulated()
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            save(found[name], path)
    return found


def check(cell: Cell, tests: dict[str, Recording]) -> tuple[CellModel, dict[str, list[Judgement]]]:
    """Identify a cell, print how right the filters are, and return the model and the judgements by race."""
    pulses = [tests["pulses25"], tests["pulses40"]]
    races = [tests["race2"], tests["race3"]]
    found = judge_case(Case(cell.name, False, [tests["slow"]], pulses, [tests["train"]], races))
    model = next(iter(found.values()))[0]
    return model, {run: whole for run, (_, whole) in found.items()}


def main() -> None:
    """Print the table and, if asked, draw the first cell's race."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", nargs="+", choices=tuple(CELLS), default=DEFAULT_CELLS)
    parser.add_argument("--full", action="store_true", help="the Doyle-Fuller-Newman model; takes many times longer")
    parser.add_argument("--keep", type=Path, help="folder for the recordings")
    parser.add_argument("--plots", type=Path, help="folder for the picture")
    args = parser.parse_args()
    if importlib.util.find_spec("pybamm") is None and args.keep is None:
        parser.exit(2, "PyBaMM is not installed: pip install voltwall[pybamm]\n")
    print(HEADER)
    judged, drawn = dict[str, list[Judgement]](), False
    for name in args.cells:
        tests = recordings(CELLS[name], args.full, args.keep)
        model, of_cell = check(CELLS[name], tests)
        judged |= of_cell
        if args.plots and not drawn:
            drawn = True
            run = tests["race2"]
            sensed = disturbed(run, model.capacity_ah, 1.0, 1.0)
            starts = {"right start": float(run.soc[0]), "50 points off": float(run.soc[0]) - 0.5}
            shown = {label: estimate(model, run, sensed, "fused", soc) for label, soc in starts.items()}
            shown["count alone"] = estimate(model, run, sensed, "coulomb", float(run.soc[0]))
            draw_physics(args.plots / "physics-check.svg", run, shown)
    print_summary(judged)
    worst = max(float(each.excess.max()) for whole in judged.values() for each in whole[:N_PINNED])
    print(f"whole races: the fusion is worse than the better of its parts by {worst:.2f} points at most")


if __name__ == "__main__":
    main()
