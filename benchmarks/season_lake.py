"""What a season lake costs and how quickly it answers, beside the session files: `python -m benchmarks.season_lake`.

One session of half an hour is recorded, the simulated race where --race is given, and made into a lake; the season is
this session of the lake a hundred times under other names. The session files are read through the same reader that
all of Voltwall uses. Seconds are of processor time over all threads and by the clock, the shortest of a few runs.
"""

import argparse
import os
import shutil
import statistics
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from app.analysis.laps.from_session import lap_table
from app.analysis.session_survey import survey_session
from app.season.lake.build import build_lake
from app.season.lake.place import Place
from app.season.lake.schema import SAMPLES, WHOLE
from app.season.store import SeasonStore
from app.sessions.reading.reader import SessionFile
from benchmarks.analysis import record
from tests.recorded.scenario import ScenarioRecorder

QUESTIONS = {
    "lowest voltage of each cell and lap": "SELECT session, lap, cell, min(voltage_min_v) FROM cells GROUP BY 1, 2, 3",
    "resistance of each cell": f"SELECT session, cell, resistance_ohm FROM cells WHERE lap = {WHOLE}",
    "a signal of all sessions, each sample": 'SELECT session, time, "v[36]" FROM samples',
}


def measured(action: Callable[[], object], runs: int) -> tuple[float, float]:
    """Return the least processor time and the least time by the clock of some runs [s]."""
    times = []
    for _ in range(runs):
        cpu_s, wall_s = time.process_time(), time.perf_counter()
        action()
        times.append((time.process_time() - cpu_s, time.perf_counter() - wall_s))
    return min(each[0] for each in times), min(each[1] for each in times)


def copied(lake: Path, target: Path, sessions: int) -> None:
    """Copy the one session of a lake under other names; the text columns tell the new name."""
    (source,) = lake.glob("car=*/season=*/session=*")
    tables = {path.stem: pq.read_table(path, partitioning=None) for path in source.glob("*.parquet")}
    for k in range(sessions):
        name = f"{source.name.removeprefix('session=')}-{k}"
        folder = target / source.relative_to(lake).parent / f"session={name}"
        folder.mkdir(parents=True)
        for table, rows in tables.items():
            if table == SAMPLES:  # as it was written, so that its encoding is what a build makes
                shutil.copyfile(source / f"{SAMPLES}.parquet", folder / f"{SAMPLES}.parquet")
                continue
            at = rows.schema.get_field_index("session")
            names = pa.array([name] * rows.num_rows).cast(rows.schema.field(at).type)
            renamed = rows.set_column(at, rows.schema.field(at), names)
            pq.write_table(renamed, folder / f"{table}.parquet", compression="zstd")


def from_files(paths: list[Path]) -> dict[str, Callable[[], object]]:
    """Return how the session files themselves answer the same."""

    def lowest() -> object:
        found = []
        for path in paths:
            with SessionFile(path) as session:
                ends = [each.lap.end_s for each in lap_table(session).laps]
                for block in session.fields(("v",)):
                    cuts = np.searchsorted(block["v"].time_s, ends)
                    found += [part.min(axis=0) for part in np.split(block["v"].values, cuts) if len(part)]
        return found

    def resistance() -> object:
        found = []
        for path in paths:
            with SessionFile(path) as session:
                found.append(survey_session(session).resistance_ohm)
        return found

    def signal() -> object:
        found = []
        for path in paths:
            with SessionFile(path) as session:
                (samples,) = session.samples([session.signals.find("v[36]")])
                found.append(samples.counts)
        return found

    return dict(zip(QUESTIONS, (lowest, resistance, signal), strict=True))


def race(folder: Path, minutes: float) -> Path:
    """Record the simulated race."""
    recorder = ScenarioRecorder(folder, "race-day", looks_ahead=False)
    recorder.run(60.0 * minutes)
    recorder.recorder.close(60.0)
    return recorder.info.path


def main() -> None:
    """Record, build, copy, ask, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sessions", type=int, default=100)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--race", action="store_true", help="the simulated race, which takes minutes to record")
    parser.add_argument("--session", type=Path, help="a recorded session instead of one that is made")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        made = race if arguments.race else lambda where, minutes: record(where, minutes / 60.0)
        path = arguments.session or made(folder / "sessions", arguments.minutes)
        one, season = folder / "one", folder / "season"
        costs = [measured(lambda: build_lake(Place(one), [path], again=True), 1) for _ in range(arguments.runs + 1)][1:]
        sizes = {file.stem: file.stat().st_size for file in one.rglob("*.parquet")}
        print(f"session file {path.stat().st_size / 1e6:.1f} MB, in the lake {sum(sizes.values()) / 1e6:.1f} MB, of it")
        print(", ".join(f"{table} {size / 1e6:.2f} MB" for table, size in sizes.items()))
        median = statistics.median(cost[0] for cost in costs)
        print(f"built with {min(costs)[0]:.2f} s of processor time, median {median:.2f} s")
        copied(one, season, arguments.sessions)
        paths = []
        for k in range(arguments.sessions):
            paths.append(folder / f"s-{k}.sqlite")
            os.link(path, paths[-1]) if path.stat().st_dev == folder.stat().st_dev else shutil.copyfile(path, paths[-1])
        store = SeasonStore(season)
        files = from_files(paths)
        print(f"{arguments.sessions} sessions: processor time / by the clock [s]")
        for question, sql in QUESTIONS.items():
            asked_cpu_s, asked_s = measured(partial(store.query, sql), arguments.runs)
            cpu_s, wall_s = measured(files[question], 1)
            print(f"{question}: lake {asked_cpu_s:.2f} / {asked_s:.2f}, session files {cpu_s:.1f} / {wall_s:.1f}")


if __name__ == "__main__":
    main()
