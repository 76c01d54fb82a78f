"""How long it takes to look back on a session of hours: `python -m benchmarks.analysis [--hours 4]`.

The session is the master's own stream at 10 Hz with numbers as noisy as real ones and a power that repeats in laps,
recorded as fast as the disk takes it. Each figure is the CPU time of the shortest of a few runs.
"""

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from app.analysis.black_box.from_session import black_boxes
from app.analysis.laps.detection import laps_by_pattern
from app.analysis.laps.from_session import lap_table, overlay_laps
from app.analysis.passport.keeper import record_of
from app.analysis.report.report import report_of
from app.analysis.session_arrays import read_totals
from app.analysis.session_survey import survey_session
from app.estimation.cell_model.cell_file import load_cell
from app.sessions.reading.reader import SessionFile
from app.sessions.recording.recorder import Recorder
from app.telemetry.events import Event
from app.words import Message
from benchmarks.recording import EPOCH_NS, stream
from firmware_protocol.memory_map import N_CELLS
from tests.fake_clock import FunctionClock

TS_S = 0.1
TRIP_EVERY_S = 1800.0


def record(folder: Path, hours: float) -> Path:
    """Record a session of so many hours and return its file."""
    recorder = Recorder(
        folder, FunctionClock(lambda: 0, lambda: EPOCH_NS), version="benchmark", free_bytes=lambda _: 1 << 40
    )
    path = recorder.start("long").path
    soc = np.linspace(0.9, 0.88, N_CELLS)
    next_trip_s = TRIP_EVERY_S
    for count, (at_s, is_fast, raw) in enumerate(stream(TS_S, hours * 3600)):
        at_ns = round(at_s * 1e9)
        recorder.frame(at_ns, EPOCH_NS + at_ns, 0, raw, True)
        if is_fast:
            recorder.estimates(at_ns, round(at_s * 1000), soc - at_s * 4e-5, np.full(N_CELLS, 0.01))
        if at_s > next_trip_s:
            next_trip_s += TRIP_EVERY_S
            told = Message("verbatim", text="cell under-voltage")
            trip = Event(EPOCH_NS + at_ns, "trip", "trip-v-min", told, cell=30, value=2.4, limit=2.5, unit="V")
            recorder.event(at_ns, trip)
        if count % 5000 == 0:
            recorder.flush(60.0)
    recorder.close(60.0)
    return path


def shortest_s(runs: int, action: Callable[[], object]) -> float:
    """Return the least CPU time of some runs, so that other work on the machine counts little."""
    times = []
    for _ in range(runs):
        started = time.process_time()
        action()
        times.append(time.process_time() - started)
    return min(times)


def main() -> None:
    """Record, look back, print a line a figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=4.0)
    parser.add_argument("--runs", type=int, default=2)
    parser.add_argument("--session", type=Path, help="look back on this one instead of a made one")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = arguments.session or record(Path(folder), arguments.hours)
        cell = load_cell()
        with SessionFile(path) as session:
            totals = read_totals(session)
            table = lap_table(session)
            laps = [each.lap for each in table.laps]
            actions: dict[str, Callable[[], object]] = {
                "totals of the accumulator": lambda: read_totals(session),
                "laps by the pattern of the power": lambda: laps_by_pattern(totals.time_s, totals.power_w),
                f"lap table ({len(laps)} laps)": lambda: lap_table(session),
                "survey of all cells": lambda: survey_session(session),
                "report": lambda: report_of(session),
                f"black boxes ({len(black_boxes(session))})": lambda: black_boxes(session),
                "record for the cell passports": lambda: record_of(session, cell),
            }
            if len(laps) > 1:
                actions["two laps on each other"] = lambda: overlay_laps(session, laps, [0, 1], "v[36]", 400)
            print(f"{session.info.duration_s / 3600:.2f} h, {len(totals.time_s)} samples, {session.info.frames} frames")
            for name, action in actions.items():
                print(f"{name:36} {shortest_s(arguments.runs, action):8.2f} s")


if __name__ == "__main__":
    main()
