"""A race of 24 hours, recorded, opened and checked: `python -m benchmarks.day_race [--hours 24]`.

The simulated car drives, changes drivers, charges and drives again (scenario `race-day`, over and over) as fast as it
can be computed. Every byte of its line goes through decoder, pipeline, estimator and recorder into one session. Then
the file is opened and compared with what the line carried: a digest over all frames, counts, the order of time; and
it is asked what people ask: the list, signals over all of it, laps, the report. Exit code 1 where anything is missing.
"""

import argparse
import hashlib
import resource
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from app.analysis.report.report import report_of
from app.sessions.reading.reader import SessionFile
from benchmarks.record_scenario import ScenarioRecorder

SETTLED_S = 300.0  # a filter that was just started has not found the charge yet
SAMPLE_S = 60.0
SIGNALS = ("i_fs", "v[36]", "t[95]", "estimate.soc[36]")


class DayRace(ScenarioRecorder):
    """The race, with a digest of what the line carried and the estimate's error against the truth."""

    def __init__(self, folder: Path, scenario: str) -> None:
        super().__init__(folder, scenario, looks_ahead=False)
        self.worst_soc = 0.0

    def hour(self, seconds: float) -> None:
        """Go on; look at the truth once a minute."""
        end_s = self.now_ns / 1e9 + seconds
        while self.now_ns / 1e9 < end_s - 1e-6:
            self.run(min(SAMPLE_S, end_s - self.now_ns / 1e9))
            if self.soc is not None and self.now_ns / 1e9 > SETTLED_S:
                error = np.abs(self.soc - self.director.simulation.accumulator.soc)
                self.worst_soc = max(self.worst_soc, float(error.max()))


def stored_digest(session: SessionFile) -> tuple[int, str, bool]:
    """Return how many frames a session holds, the digest over them, and whether time never goes back in it."""
    digest, count, before_ns, in_order = hashlib.sha256(), 0, 0, True
    for frame in session.frames():
        digest.update(frame.raw)
        in_order &= frame.t_mono_ns >= before_ns
        before_ns = frame.t_mono_ns
        count += 1
    return count, digest.hexdigest(), in_order


def timed(action: Callable[[], Any]) -> tuple[float, Any]:
    """Return the CPU time of an action [s] and its result."""
    started_s = time.process_time()
    result = action()
    return time.process_time() - started_s, result


def peak_mb() -> float:
    """The most memory that this process ever held."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1e6 if sys.platform == "darwin" else 1e3)


def check(race: DayRace) -> list[str]:
    """Open the session, print how quickly it answers, and return what is wrong with it."""
    path, wrong = race.info.path, []
    opened_s, info = timed(lambda: _info(path))
    print(f"opened in {1000 * opened_s:.0f} ms: {info.duration_s / 3600:.2f} h, {info.size_bytes / 1e6:.0f} MB")
    with SessionFile(path) as session:
        count, digest, in_order = stored_digest(session)
        if (count, digest) != (race.sent, race.digest.hexdigest()):
            wrong.append(f"{race.sent} frames were sent, {count} are stored, or not the same bytes")
        if not in_order:
            wrong.append("time goes back")
        wrong += session.problems()
        for signal in SIGNALS:
            for part in (1.0, 0.1, 0.002):
                end_s = info.started_wall_ns / 1e9 + info.duration_s * part
                answered_s, series = timed(partial(session.series, [signal], None, end_s))
                points = len(series[signal].time_s)
                print(f"2,000 points of {signal} over {part:g} of it: {1000 * answered_s:.0f} ms, {points}")
        reported_s, report = timed(lambda: report_of(session))
        print(f"report in {reported_s:.1f} s: {report.headline}")
        print(f"{len(report.laps.laps)} laps, {len(report.events)} events")
    if not info.is_closed:
        wrong.append("not closed")
    return wrong


def _info(path: Path) -> Any:
    with SessionFile(path) as session:
        return session.info


def main() -> int:
    """Race, look, tell."""
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
