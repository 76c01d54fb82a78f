import sqlite3
import threading
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from app.sessions.errors import RecordingFailed
from app.sessions.event_log import EventLog
from app.sessions.storage.database import EVENTS
from app.telemetry import Event, Severity
from app.words import Message, render
from tests.fake_clock import FakeClock
from tests.service_process import until


def event(text: str, severity: Severity = "info", **about: Any) -> Event:
    return Event(1, severity, "code", Message("verbatim", text=text), **about)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "data" / "events.sqlite"


def test_events_and_their_ids_survive_a_restart(path: Path) -> None:
    log = EventLog(path, FakeClock())
    too_low = Event(1, "trip", "v_min", Message("cell-undervoltage"), cell=36, value=2.4, limit=2.5, unit="V")
    first = log.append(too_low, uptime_ms=77)
    log.close()
    log = EventLog(path, FakeClock())
    second = log.append(event("service started", who="anna"))
    events = log.query()
    log.close()
    assert second > first
    assert events[1].message == '{"code":"cell-undervoltage","args":{}}'
    assert events[1].text == "cell undervoltage"
    assert [event.id for event in events] == [second, first]
    assert (events[1].cell, events[1].value, events[1].limit, events[1].unit, events[1].uptime_ms) == (
        36,
        2.4,
        2.5,
        "V",
        77,
    )


def test_query_filters_by_id_severity_and_cell_newest_first(path: Path) -> None:
    log = EventLog(path, FakeClock())
    ids = [log.append(event(str(i), "trip" if i % 2 else "info", cell=i % 3)) for i in range(12)]
    assert [e.id for e in log.query(limit=3)] == ids[:-4:-1]
    assert [e.id for e in log.query(after=ids[8])] == ids[:8:-1]
    assert {e.severity for e in log.query(severity="trip")} == {"trip"}
    assert [e.text for e in log.query(severity="info", cell=0)] == ["6", "0"]
    log.close()


def test_the_first_acknowledgement_stays(path: Path) -> None:
    clock = FakeClock()
    log = EventLog(path, clock)
    event_id = log.append(event("text"))
    assert log.acknowledge(event_id, "anna")
    assert log.acknowledge(event_id, "ben")
    assert not log.acknowledge(event_id + 1, "anna")
    logged = log.get(event_id)
    assert logged is not None
    assert (logged.acknowledged_by, logged.acknowledged_ns) == ("anna", clock.wall_ns())
    log.close()


def test_many_threads_append_without_loss(path: Path) -> None:
    log = EventLog(path, FakeClock())
    threads = [threading.Thread(target=lambda: [log.append(event("t")) for _ in range(50)]) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len({event.id for event in log.query(limit=1000)}) == 200
    log.close()


def test_events_wait_in_memory_while_the_disk_takes_none(path: Path) -> None:
    log = EventLog(path, FakeClock())
    log.append(event("before"))
    log.flush()
    other = sqlite3.connect(path, isolation_level=None)
    other.execute("CREATE TRIGGER full BEFORE INSERT ON events BEGIN SELECT RAISE(FAIL, 'disk is full'); END")
    waiting = log.append(event("meanwhile"))
    assert [event.text for event in log.query()] == ["meanwhile", "before"]
    until(lambda: log.error is not None)
    assert "disk is full" in render(log.error)
    other.execute("DROP TRIGGER full")
    until(lambda: log.error is None)
    assert other.execute("SELECT text FROM events WHERE id = ?", (waiting,)).fetchone() == ("meanwhile",)
    other.close()
    log.close()


def test_another_program_that_holds_the_lock_delays_neither_events_nor_who_reads_them(path: Path) -> None:
    log = EventLog(path, FakeClock())
    before = log.append(event("before"))
    log.flush()
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute("BEGIN EXCLUSIVE")
        began_s = time.monotonic()
        for number in range(20):
            log.append(event(str(number)))
            assert log.query(limit=1)[0].text == str(number)
        with pytest.raises(RecordingFailed):
            log.acknowledge(before, "anna")
        assert time.monotonic() - began_s < 3.0
        other.execute("ROLLBACK")
    log.flush()
    assert [each.text for each in log.query()] == [*(str(number) for number in reversed(range(20))), "before"]
    log.close()


def test_a_log_of_the_first_version_keeps_its_sentences(path: Path) -> None:
    path.parent.mkdir(parents=True)
    old = sqlite3.connect(path, isolation_level=None)
    old.executescript(EVENTS.steps[0])
    old.execute("INSERT INTO events (t_wall_ns, severity, code, text, unit) VALUES (1, 'info', 'x', 'as it was', '')")
    old.execute(f"PRAGMA application_id = {EVENTS.application_id}")
    old.execute("PRAGMA user_version = 1")
    old.close()
    log = EventLog(path, FakeClock())
    log.append(event("new"))
    assert [(each.text, each.message is None) for each in log.query()] == [("new", False), ("as it was", True)]
    log.close()


def test_another_programs_file_is_set_aside(tmp_path: Path) -> None:
    path = tmp_path / "x.sqlite"
    connection = sqlite3.connect(path)
    connection.execute("CREATE TABLE t (a)")
    connection.close()
    EventLog(path, FakeClock()).close()
    (kept,) = tmp_path.glob("x.sqlite.damaged-*")
    with closing(sqlite3.connect(kept)) as other:
        assert other.execute("SELECT name FROM sqlite_master").fetchall() == [("t",)]
