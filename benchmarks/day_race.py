"""A race of 24 hours, recorded, opened and checked: `python -m benchmarks.day_race [--hours 24]`.

The simulated car drives, changes drivers, charges and drives again (scenario `race-day`, over and over) as fast as it
can be computed. Every byte of its line goes through decoder, pipeline, estimator and recorder into one session. Then
the file is opened and compared with what the line carried: a digest over all frames, counts, the order of time; and
it is asked what people ask: the list, signals over all of it, laps, the report. Exit code 1 where anything is missing.
"""

import argparse
import resource
import sys
import tempfile
import time
from pathlib import Path

from tests.recorded.day_race import SETTLED_S, DayRace, check


def peak_mb() -> float:
    """The most memory that this process ever held."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1e6 if sys.platform == "darwin" else 1e3)


def main() -> int:
    """Record the race, check the session, print the result."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--scenario", default="race-day")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        race = DayRace(Path(folder), arguments.scenario)
        started_s, left_s = time.process_time(), arguments.hours * 3600
        while left_s > 0:
            race.hour(min(3600.0, left_s))
            left_s -= 3600.0
            hours, cpu_s = race.now_ns / 3.6e12, time.process_time() - started_s
            print(f"{hours:6.2f} h  {race.sent:>8} frames  {cpu_s:6.0f} s of CPU  peak {peak_mb():.0f} MB", flush=True)
        race.close()
        print(f"worst error of any cell's charge after {SETTLED_S:.0f} s: {100 * race.worst_soc:.2f} %")
        wrong = check(race)
    print("\n".join(wrong) or "nothing lost")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
