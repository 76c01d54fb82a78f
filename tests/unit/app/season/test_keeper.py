import importlib.util
import os
import shutil
import threading
import time
from pathlib import Path

import pytest

from app.errors import ConfigError, ExtraMissing, NotNow
from app.season import keeper
from app.season.keeper import SeasonLake
from app.season.lake.build import build_lake, session_files
from app.season.lake.place import Place
from app.season.store.store import Limits, QueryFailed
from app.telemetry import Event
from app.words import Message

SEEN_S = 60.0


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


def test_a_closed_session_is_built_by_itself_and_asked_about(data, monkeypatch):
    monkeypatch.setattr(keeper, "NICE", 0)  # at the lowest priority a busy machine would not come to it for minutes
    lake = SeasonLake(data, None, builds=True)
    lake.start()
    try:
        until(lambda: marks(data))
        answer = lake.query("SELECT count(*) AS n FROM cells WHERE cell < $below", {"below": "2"})
        assert answer == {"columns": ["n"], "rows": [[8]], "is_cut": False}
    finally:
        lake.stop()


def test_a_recording_that_ends_wakes_the_build(data, monkeypatch):
    begun = threading.Event()
    monkeypatch.setattr(SeasonLake, "_build", lambda self: begun.set())
    lake = SeasonLake(data, None, builds=True)
    monkeypatch.setattr(lake, "_is_behind", lambda sessions: False)
    lake.start()
    try:
        lake.on_event(Event(0, "info", "note", Message("verbatim", text="nothing")))
        assert not lake._wanted.is_set()
        lake.on_event(Event(0, "info", "recording-stopped", Message("verbatim", text="ended")))
        assert begun.wait(SEEN_S)
    finally:
        lake.stop()


def test_nothing_is_built_where_it_is_off(data):
    lake = SeasonLake(data, None, builds=False)
    lake.start()
    lake.stop()
    assert marks(data) == []


@pytest.mark.parametrize(("after_s", "is_behind"), [(-1.0, False), (0.0, True), (1.0, True)])
def test_it_is_behind_where_a_session_changed_since_the_last_build_began(data, after_s, is_behind):
    (data / "lake").mkdir()
    lock, (session,) = data / "lake" / ".lock", (data / "sessions").iterdir()
    lock.touch()
    built_s = lock.stat().st_mtime
    os.utime(session, (built_s + after_s, built_s + after_s))
    lake = SeasonLake(data, None, builds=True)
    lake.update([session])
    assert lake.is_building == is_behind


def test_a_wrong_question_says_why(lake, tmp_path):
    asked = SeasonLake(tmp_path, str(lake), builds=False)
    with pytest.raises(QueryFailed, match="one SELECT"):
        asked.query("DROP TABLE cells", {})


def test_a_service_without_a_session_answers(tmp_path):
    asked = SeasonLake(tmp_path, None, builds=False)
    assert asked.query("SELECT 7 AS n", {})["rows"] == [[7]]
    assert asked.query("SELECT count(*) AS n FROM sessions", {})["rows"] == [[0]]


def test_a_question_that_hangs_is_killed(lake, tmp_path, monkeypatch):
    monkeypatch.setattr("app.season.keeper.START_S", 0.0)
    asked = SeasonLake(tmp_path, str(lake), builds=False)
    with pytest.raises(QueryFailed, match="longer than"):
        asked.query("SELECT 1 AS one", {}, Limits(seconds=0.01))


def test_a_service_that_ends_waits_for_no_question(lake, tmp_path, monkeypatch):
    command = keeper._command  # one that ends the service as soon as the question's process is there
    asked = SeasonLake(tmp_path, str(lake), builds=False)
    ending = threading.Thread(target=lambda: (until(lambda: asked._query_process is not None), asked.stop()))
    monkeypatch.setattr(keeper, "_command", lambda words: (ending.start(), command(words))[1])
    sql = "SELECT sum(a.range * b.range) FROM range(100000000) a, range(100000000) b"
    with pytest.raises(NotNow, match="ends"):
        asked.query(sql, {}, Limits(seconds=SEEN_S))
    ending.join()


def test_an_answer_that_fills_the_services_memory_is_not_taken(lake, tmp_path, monkeypatch):
    monkeypatch.setattr("app.season.keeper.ANSWER_MB", 1)
    asked = SeasonLake(tmp_path, str(lake), builds=False)
    with pytest.raises(QueryFailed, match="longer than 1 MB"):
        asked.query("SELECT repeat('x', 1000) AS x FROM range(2000)", {})


def test_one_question_at_a_time(lake, tmp_path):
    asked = SeasonLake(tmp_path, str(lake), builds=False)
    with asked._asking, pytest.raises(NotNow):
        asked.query("ranking", {})


def test_without_the_extra_it_says_what_to_install(tmp_path, monkeypatch):
    found = importlib.util.find_spec
    monkeypatch.setattr("app.season.keeper.find_spec", lambda name: None if name == "duckdb" else found(name))
    lake = SeasonLake(tmp_path, None, builds=True)
    lake.start()
    lake.stop()
    with pytest.raises(ExtraMissing, match=r"pip install 'voltwall\[season\]'"):
        lake.query("ranking", {})


def test_an_answer_is_remembered_until_the_lake_changes(data):
    build_lake(Place(data / "lake"), session_files([data / "sessions"]))
    lake, made = SeasonLake(data, None, builds=False), []

    def answer(question):
        return lake.remembered((question,), lambda: made.append(question) or len(made))

    assert [answer("a"), answer("a"), answer("b"), answer("a")] == [1, 1, 2, 1]
    build_lake(Place(data / "lake"), session_files([data / "sessions"]), again=True)
    assert answer("a") == 3
    for k in range(keeper.REMEMBERED):
        answer(k)
    assert answer("a") == 4 + keeper.REMEMBERED  # the oldest is forgotten


def test_nothing_is_remembered_of_a_lake_elsewhere(data):
    lake, made = SeasonLake(data, "memory://lake", builds=False), []
    for _ in range(2):
        lake.remembered(("a",), lambda: made.append("a"))
    assert len(made) == 2


NO_DISK = pytest.param("/proc/lake", marks=pytest.mark.skipif(not Path("/proc/self").exists(), reason="of Linux"))


@pytest.mark.parametrize("place", ["file", "file/below", NO_DISK])
def test_a_place_that_takes_no_lake_is_refused_at_the_start(tmp_path, place):
    (tmp_path / "file").touch()
    with pytest.raises(ConfigError, match=r"lake = .*: a folder"):
        SeasonLake(tmp_path, str(tmp_path / place), builds=False)


def test_the_place_of_a_lake_is_made_at_the_start(tmp_path):
    SeasonLake(tmp_path, str(tmp_path / "of" / "the season"), builds=False)
    assert list((tmp_path / "of" / "the season").iterdir()) == []
