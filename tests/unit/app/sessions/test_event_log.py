import sqlite3
import threading
from pathlib import Path

import pytest

from app.sessions.errors import NotASession
from app.sessions.event_log import EventLog


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "data" / "events.sqlite"


def test_events_and_their_ids_survive_a_restart(path: Path) -> None:
    log = EventLog(path)
    first = log.append("trip", "v_min", "cell too low", cell=36, value=2.4, limit=2.5, unit="V", uptime_ms=77)
    log.close()
    log = EventLog(path)
    second = log.append("info", "start", "service started", who="anna")
    events = log.query()
    log.close()
    assert second > first
    assert [event.id for event in events] == [second, first]
    assert (events[1].cell, events[1].value, events[1].limit, events[1].unit, events[1].uptime_ms) == (
        36,
        2.4,
        2.5,
        "V",
        77,
    )


def test_query_filters_by_id_severity_and_cell_newest_first(path: Path) -> None:
    log = EventLog(path)
    ids = [log.append("trip" if i % 2 else "info", "code", str(i), cell=i % 3) for i in range(12)]
    assert [e.id for e in log.query(limit=3)] == ids[:-4:-1]
    assert [e.id for e in log.query(after=ids[8])] == ids[:8:-1]
    assert {e.severity for e in log.query(severity="trip")} == {"trip"}
    assert [e.text for e in log.query(severity="info", cell=0)] == ["6", "0"]
    log.close()


def test_the_first_acknowledgement_stays(path: Path) -> None:
    log = EventLog(path, wall_ns=lambda: 123)
    event_id = log.append("warning", "x", "text")
    assert log.acknowledge(event_id, "anna")
    assert log.acknowledge(event_id, "ben")
    assert not log.acknowledge(event_id + 1, "anna")
    event = log.get(event_id)
    assert event is not None
    assert (event.acknowledged_by, event.acknowledged_ns) == ("anna", 123)
    log.close()


def test_many_threads_append_without_loss(path: Path) -> None:
    log = EventLog(path)
    threads = [threading.Thread(target=lambda: [log.append("info", "c", "t") for _ in range(50)]) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len({event.id for event in log.query(limit=1000)}) == 200
    log.close()


def test_events_wait_in_memory_while_the_disk_takes_none(path: Path) -> None:
    log = EventLog(path)
    log.append("info", "a", "before")
    log.flush()
    other = sqlite3.connect(path, isolation_level=None)
    other.execute("CREATE TRIGGER full BEFORE INSERT ON events BEGIN SELECT RAISE(FAIL, 'disk is full'); END")
    waiting = log.append("trip", "b", "meanwhile")
    assert [event.text for event in log.query()] == ["meanwhile", "before"]
    assert log.error is not None
    assert "disk is full" in log.error
    other.execute("DROP TRIGGER full")
    log.flush()
    assert log.error is None
    assert other.execute("SELECT text FROM events WHERE id = ?", (waiting,)).fetchone() == ("meanwhile",)
    other.close()
    log.close()


def test_a_session_is_no_event_log(tmp_path: Path) -> None:
    path = tmp_path / "x.sqlite"
    connection = sqlite3.connect(path)
    connection.execute("CREATE TABLE t (a)")
    connection.close()
    with pytest.raises(NotASession):
        EventLog(path)
