"""A long race recorded at speed, and the check that its session holds what the line carried."""

import hashlib
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from app.analysis.report.report import report_of
from app.sessions.reading.reader import SessionFile
from tests.recorded.scenario import ScenarioRecorder

SETTLED_S = 300.0  # a filter that was just started has not found the charge yet
SAMPLE_S = 60.0
SIGNALS = ("i_fs", "v[36]", "t[95]", "estimate.soc[36]")


class DayRace(ScenarioRecorder):
    """The race, with a digest of what the line carried and the estimate's error against the truth."""

    def __init__(self, folder: Path, scenario: str) -> None:
        super().__init__(folder, scenario, predicts=False)
        self.worst_soc = 0.0

    def hour(self, seconds: float) -> None:
        """Go on; look at the truth once a minute."""
        end_s = self.now_ns / 1e9 + seconds
        while self.now_ns / 1e9 < end_s - 1e-6:
            self.run(min(SAMPLE_S, end_s - self.now_ns / 1e9))
            if self.soc is not None and self.now_ns / 1e9 > SETTLED_S:
                error = np.abs(self.soc - self.player.simulation.accumulator.soc)
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
        print(f"report in {reported_s:.1f} s: {report.findings.headline.text}")
        print(f"{len(report.laps.laps)} laps")
    if not info.is_closed:
        wrong.append("not closed")
    return wrong


def _info(path: Path) -> Any:
    with SessionFile(path) as session:
        return session.info
