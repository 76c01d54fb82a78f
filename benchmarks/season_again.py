"""How long it takes to estimate a season again, reading included: `python -m benchmarks.season_again`.

A session is half an hour of the master's stream at 10 Hz, recorded once and copied: each copy is read from its own file
and estimated block by block, in two processes. Printed are the wall clock of the shortest run and, which other work on
the machine stretches less, the processor time of that run over its two processes.
"""

import argparse
import os
import shutil
import tempfile
import time
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.estimators import make_estimator
from app.sessions.reading.reader import SessionFile
from benchmarks.analysis import record
from firmware_protocol.memory_map import N_CELLS

PROCESSES = 2
FIELDS = ("i_fs", "v", "t")


def estimate_again(path: Path) -> tuple[int, float]:
    """Read a session, estimate it, and return its samples and the mean SOC at its end."""
    estimator, before_s, n = make_estimator("fused", load_cell("samsung-25r-10p"), N_CELLS), None, 0
    with SessionFile(path) as session:
        for block in session.fields(FIELDS):
            current, volts, degc = (block[name] for name in FIELDS)
            time_s = volts.time_s
            held_a = np.interp(time_s, current.time_s, current.values[:, 0])
            row = np.clip(np.searchsorted(degc.time_s, time_s, side="right") - 1, 0, None)
            if before_s is None:
                estimator.start(volts.values[0], degc.values[0], float(held_a[0]))
                before_s = time_s[0]
            steps_s = np.diff(time_s, prepend=before_s)
            found = estimator.run(steps_s, held_a, volts.values, degc.values[row], soc_only=True)
            before_s, n = time_s[-1], n + time_s.size
    return n, float(found.soc[-1].mean())


def season_s(paths: list[Path]) -> tuple[float, float]:
    """Return the time by the clock and the processor time of all sessions in PROCESSES processes [s]."""
    began, before = time.monotonic(), os.times()
    with get_context("fork").Pool(PROCESSES) as pool:
        pool.map(estimate_again, paths, chunksize=1)
        pool.close()
        pool.join()
    after = os.times()
    cpu_s = after.children_user + after.children_system - before.children_user - before.children_system
    return time.monotonic() - began, cpu_s


def main() -> None:
    """Record, copy, estimate again, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sessions", type=int, default=100)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--runs", type=int, default=2)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        first = record(folder, arguments.minutes / 60.0)
        paths = [folder / f"session-{k}.sqlite" for k in range(arguments.sessions)]
        for path in paths:
            shutil.copyfile(first, path)
        n, _ = estimate_again(first)
        runs = [season_s(paths) for _ in range(arguments.runs)]
    wall_s, cpu_s = min(runs)
    print(f"{arguments.sessions} sessions of {arguments.minutes:g} min, {n} samples each, on {PROCESSES} cores:")
    print(f"{wall_s:.1f} s by the clock; {cpu_s / PROCESSES:.1f} s of processor time each")
    print(f"one session: {cpu_s / arguments.sessions:.3f} s of processor time, reading included")


if __name__ == "__main__":
    main()
