"""How long it takes to estimate a season again, reading included: `python -m benchmarks.season_again`.

A session is half an hour of the master's stream at 10 Hz, recorded once and linked under other names: each is read from
its file and estimated as `voltwall season estimate` does it, in a pool of two processes. Printed are the wall clock
and, which other work on the machine stretches less, the processor time of the tasks.
"""

import argparse
import tempfile
import time
from pathlib import Path

from app.season.estimates.executor import open_engine
from app.season.estimates.results import Results, set_of
from app.season.estimates.run import estimate_season
from app.sessions.catalogue import Catalogue
from benchmarks.analysis import record

PROCESSES = 2


def main() -> None:
    """Record, link, estimate again, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sessions", type=int, default=100)
    parser.add_argument("--minutes", type=float, default=30.0)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        first = record(folder / "sessions", arguments.minutes / 60.0)
        for k in range(1, arguments.sessions):
            first.with_name(f"session-{k}.sqlite").hardlink_to(first)
        sessions, results = Catalogue(first.parent).list(), Results(folder)
        wanted = [(set_of("session", None, "fused"), None)]
        with open_engine("processes", PROCESSES) as engine:
            outcome = estimate_season(sessions, wanted, "fused", results, engine)
            began_s = time.process_time()
            estimate_season(sessions, wanted, "fused", results, engine)
            looked_s = time.process_time() - began_s
        kept = results.read_all(wanted[0][0])
    n = len(outcome.estimated)
    print(f"{n} sessions of {arguments.minutes:g} min, {kept[0]['samples']} samples each, on {PROCESSES} cores:")
    print(f"{outcome.took_s:.1f} s by the clock; {outcome.processor_s / PROCESSES:.1f} s of processor time each")
    print(f"one session: {outcome.processor_s / n:.3f} s of processor time, reading included")
    print(f"a run that finds all results there: {1e3 * looked_s / n:.1f} ms of processor time a session")


if __name__ == "__main__":
    main()
