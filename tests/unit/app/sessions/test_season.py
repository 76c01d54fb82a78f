"""A season: a hundred sessions in one folder, listed at once."""

import shutil
import time
from pathlib import Path

from app.sessions.catalogue import Catalogue
from app.sessions.writer import Recorder

N = 100


def test_a_season_of_a_hundred_sessions_is_listed_quickly(recorder: Recorder, stream, tmp_path: Path) -> None:
    info = recorder.start()
    stream.feed(recorder, 700)
    recorder.close()
    folder = tmp_path / "season"
    folder.mkdir()
    for number in range(N):
        shutil.copy(info.path, folder / f"run-{number}.sqlite")
    catalogue = Catalogue(folder)
    started, cpu = time.perf_counter(), time.process_time()
    assert len(catalogue.list()) == N
    first_s, first_cpu_s = time.perf_counter() - started, time.process_time() - cpu
    cpu = time.process_time()
    assert {session.frames for session in catalogue.list()} == {700}
    again_s = time.process_time() - cpu
    assert first_cpu_s < 1.0, first_s
    assert again_s < 0.1
    print(f"{N} sessions: {first_s * 1000:.0f} ms, then {again_s * 1000:.0f} ms of CPU")
