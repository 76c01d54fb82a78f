"""A season: a hundred sessions in one folder, listed at once."""

import shutil
import time
from pathlib import Path

from app.sessions.catalogue import Catalogue
from app.sessions.recording.recorder import Recorder

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
    cpu = time.process_time()
    assert len(catalogue.list()) == N
    first_s, cpu = time.process_time() - cpu, time.process_time()
    assert {session.frames for session in catalogue.list()} == {700}
    again_s, cpu = time.process_time() - cpu, time.process_time()
    assert Catalogue(folder).list() == catalogue.list()  # a program that was just started
    restarted_s = time.process_time() - cpu
    assert first_s < 1.0
    assert again_s < 0.1
    assert restarted_s < 0.1
    print(f"{N} sessions, CPU: {1e3 * first_s:.0f} ms, then {1e3 * again_s:.0f}, restarted {1e3 * restarted_s:.0f} ms")
