import importlib.util
import os
import shutil
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import pytest

from app.errors import ConfigError, ExtraMissing, NotNow
from app.season.lake.build import build_lake, session_files
from app.season.lake.place import LakeFolder
from app.season.season_lake import REMEMBERED, SeasonLake
from app.season.store.store import QueryFailed, QueryLimits
from app.sessions.worker import Workers
from app.telemetry import Event
from app.words import Message

SEEN_S = 180.0  # worker processes run after all others


@pytest.fixture(scope="module")
def workers():
    with closing(Workers()) as made:
        yield made


@pytest.fixture
def data(season, tmp_path) -> Path:
    """A data folder with a session."""
    (tmp_path / "sessions").mkdir()
    shutil.copy(min(season.glob("*.sqlite")), tmp_path / "sessions")
    return tmp_path


def marks(data: Path) -> list[Path]:
    return list((data / "lake").rglob("sessions.parquet"))


def until(condition) -> None:
    deadline = time.monotonic() + SEEN_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_a_closed_session_is_built_and_asked_about(data, workers):
    lake = SeasonLake(data, None, workers, builds=True)
    lake.start()
    until(lambda: marks(data))
    answer = lake.query("SELECT count(*) AS n FROM cells WHERE cell < $below", {"below": "2"})
    assert answer == {"columns": ["n"], "rows": [[8]], "is_cut": False}
    lake.stop()


def test_a_recording_that_ends_is_built_and_what_cannot_be_is_named(data, workers, caplog):
    lake = SeasonLake(data, None, workers, builds=True)
    (data / "sessions" / "broken.sqlite").write_bytes(b"no session")
    lake.on_event(Event(0, "info", "note", Message("verbatim", text="nothing")))
    assert not lake.is_building
    lake.on_event(Event(0, "info", "recording-stopped", Message("verbatim", text="ended")))
    until(lambda: not lake.is_building)
    assert len(marks(data)) == 1
    assert "broken" in caplog.text
    lake.stop()


def test_nothing_is_built_where_it_is_off(data, workers):
    lake = SeasonLake(data, None, workers, builds=False)
    lake.start()
    lake.stop()
    assert marks(data) == []


@pytest.mark.parametrize(("after_s", "is_behind"), [(-1.0, False), (0.0, True), (1.0, True)])
def test_it_is_behind_where_a_session_changed_since_the_last_build_began(data, after_s, is_behind, workers):
    (data / "lake").mkdir()
    lock, (session,) = data / "lake" / ".lock", (data / "sessions").iterdir()
    lock.touch()
    built_s = lock.stat().st_mtime
    os.utime(session, (built_s + after_s, built_s + after_s))
    lake = SeasonLake(data, None, workers, builds=True)
    lake.update([session])
    assert lake.is_building == is_behind
    lake.stop()
    until(lambda: not lake.is_building)


def test_a_wrong_question_says_why(lake, tmp_path, workers):
    asked = SeasonLake(tmp_path, str(lake), workers, builds=False)
    with pytest.raises(QueryFailed, match="one SELECT"):
        asked.query("DROP TABLE cells", {})


def test_a_service_without_a_session_answers(tmp_path, workers):
    asked = SeasonLake(tmp_path, None, workers, builds=False)
    assert asked.query("SELECT 7 AS n", {})["rows"] == [[7]]
    assert asked.query("SELECT count(*) AS n FROM sessions", {})["rows"] == [[0]]


def test_a_question_that_hangs_is_killed(lake, tmp_path, monkeypatch, workers):
    monkeypatch.setattr("app.season.season_lake.START_S", 0.0)
    asked = SeasonLake(tmp_path, str(lake), workers, builds=False)
    with pytest.raises(QueryFailed, match="longer than"):
        asked.query("SELECT 1 AS one", {}, QueryLimits(seconds=0.01))


def test_a_service_that_ends_waits_for_no_question(lake, tmp_path):
    workers = Workers()
    asked = SeasonLake(tmp_path, str(lake), workers, builds=False)
    sql = "SELECT sum(a.range * b.range) FROM range(100000000) a, range(100000000) b"
    with ThreadPoolExecutor(1) as thread:
        answer = thread.submit(asked.query, sql, {}, QueryLimits(seconds=SEEN_S))
        until(lambda: workers._busy)
        asked.stop()
        workers.close()
        with pytest.raises(NotNow, match="is stopping"):
            answer.result(SEEN_S)


def test_an_answer_that_fills_the_services_memory_is_not_taken(lake, tmp_path, monkeypatch, workers):
    monkeypatch.setattr("app.season.season_lake.ANSWER_MB", 1)
    asked = SeasonLake(tmp_path, str(lake), workers, builds=False)
    with pytest.raises(QueryFailed, match="larger than 1 MB"):
        asked.query("SELECT repeat('x', 1000) AS x FROM range(2000)", {})


def test_one_question_at_a_time(lake, tmp_path, workers):
    asked = SeasonLake(tmp_path, str(lake), workers, builds=False)
    with asked._asking, pytest.raises(NotNow):
        asked.query("ranking", {})


def test_without_the_extra_it_says_what_to_install(tmp_path, monkeypatch, workers):
    found = importlib.util.find_spec
    monkeypatch.setattr("app.season.season_lake.find_spec", lambda name: None if name == "duckdb" else found(name))
    lake = SeasonLake(tmp_path, None, workers, builds=True)
    lake.start()
    lake.stop()
    with pytest.raises(ExtraMissing, match=r"pip install 'voltwall\[season\]'"):
        lake.query("ranking", {})


def test_an_answer_is_remembered_until_the_lake_changes(data, workers):
    build_lake(LakeFolder(data / "lake"), session_files([data / "sessions"]))
    lake, made = SeasonLake(data, None, workers, builds=False), []

    def answer(question):
        return lake.remembered((question,), lambda: made.append(question) or len(made))

    assert [answer("a"), answer("a"), answer("b"), answer("a")] == [1, 1, 2, 1]
    build_lake(LakeFolder(data / "lake"), session_files([data / "sessions"]), again=True)
    assert answer("a") == 3
    for k in range(REMEMBERED):
        answer(k)
    assert answer("a") == 4 + REMEMBERED  # the oldest is forgotten


def test_nothing_is_remembered_of_a_lake_elsewhere(data, workers):
    lake, made = SeasonLake(data, "memory://lake", workers, builds=False), []
    for _ in range(2):
        lake.remembered(("a",), lambda: made.append("a"))
    assert len(made) == 2


NO_DISK = pytest.param("/proc/lake", marks=pytest.mark.skipif(not Path("/proc/self").exists(), reason="of Linux"))


@pytest.mark.parametrize("place", ["file", "file/below", NO_DISK])
def test_a_place_that_takes_no_lake_is_refused_at_the_start(tmp_path, place, workers):
    (tmp_path / "file").touch()
    with pytest.raises(ConfigError, match=r"lake = .*: a (writable )?folder"):
        SeasonLake(tmp_path, str(tmp_path / place), workers, builds=False)


def test_the_place_of_a_lake_is_made_at_the_start(tmp_path, workers):
    SeasonLake(tmp_path, str(tmp_path / "of" / "the season"), workers, builds=False)
    assert list((tmp_path / "of" / "the season").iterdir()) == []
