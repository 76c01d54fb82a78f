"""How long it takes to estimate a season again, reading included: `python -m benchmarks.season_again`.

A session is half an hour of the master's stream at 10 Hz, recorded once and copied: each copy is read from its own file
and estimated block by block, in two processes. Time by the clock on the wall, of the shortest run.
"""

import argparse
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
            found = estimator.run(np.diff(time_s, prepend=before_s), held_a, volts.values, degc.values[row])
            before_s, n = time_s[-1], n + time_s.size
    return n, float(found.soc[-1].mean())


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
        began = time.process_time()
        n, _ = estimate_again(first)
        one_s = time.process_time() - began
        with get_context("fork").Pool(2) as pool:
            times = []
            for _ in range(arguments.runs):
                began = time.monotonic()
                pool.map(estimate_again, paths, chunksize=1)
                times.append(time.monotonic() - began)
    print(
        f"{arguments.sessions} sessions of {arguments.minutes:g} min, {n} samples each: {min(times):.1f} s on two cores"
    )
    print(f"one session: {one_s:.3f} s of processor, reading included")


if __name__ == "__main__":
    main()
