"""Every change of the configuration is one line of the event log, and one record where the master was asked."""

import errno
import threading
import time

import pytest

from app.configuration.history import BEGUN, ConfigHistory, JsonLines
from app.configuration.write_log import Attempt, WriteLog
from app.errors import NotNow
from app.sessions.errors import RecordingFailed
from app.words import render
from firmware_protocol.config_image import default_image, difference, with_raw
from tests.fake_clock import FakeClock
from tests.service_process import WAIT_S, until

HOTTER = with_raw(default_image(), "t_cell_max", 55)


class Notes(list):
    """Keeps the lines of the event log."""

    def __call__(self, severity, code, message, who=None):
        self.append((severity, code, message, who))


@pytest.fixture
def notes():
    return Notes()


@pytest.fixture
def history(tmp_path):
    return ConfigHistory(tmp_path)


@pytest.fixture
def log(history, notes):
    return WriteLog(history, notes, FakeClock(wall_s=5.0))


def attempt(action="write"):
    return Attempt("anna", action, "draft", " a hot day ", default_image(), HOTTER)


def test_a_write_names_its_changes_and_reason(log, notes, history):
    log.written(attempt(), difference(default_image(), HOTTER))
    ((severity, code, message, who),) = notes
    text = render(message)
    assert (severity, code, who) == ("info", "config-written", "anna")
    assert "t_cell_max" in text
    assert "a hot day" in text
    (record,) = history.records()
    assert (record.t_wall_ns, record.who, record.action, record.source) == (5 * 10**9, "anna", "write", "draft")
    assert (record.before, record.after, record.reason) == (default_image(), HOTTER, "a hot day")
    assert (record.result, record.is_genuine) == ("done", True)


def test_many_changes_are_cut_short(log, notes):
    changes = difference(default_image(), HOTTER) * 11
    log.written(attempt(), changes)
    text = render(notes[0][2])
    assert text.count("t_cell_max") == 8
    assert "3 more" in text


def test_a_load_that_changes_nothing_says_so(log, notes):
    log.loaded(attempt("load"), [])
    assert "no changes" in render(notes[0][2])


@pytest.mark.parametrize(
    ("action", "code"),
    [
        ("write", "config-write-failed"),
        ("rollback", "config-write-failed"),
        ("store", "config-store-failed"),
        ("load", "config-load-failed"),
    ],
)
def test_a_failure_is_a_warning_of_its_kind(log, notes, history, action, code):
    log.failed(attempt(action), NotNow("blocked while the contactors are closed"), None)
    ((severity, found, message, who),) = notes
    assert (severity, found, who) == ("warning", code, "anna")
    assert "blocked while the contactors are closed" in render(message)
    assert history.records() == []


def test_a_failure_that_reached_the_master_is_in_the_history(log, history):
    log.failed(attempt(), NotNow("cut"), "not verified, not known: cut")
    assert history.records()[0].result == "not verified, not known: cut"


def test_a_history_that_cannot_be_written_is_told(log, notes, history, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(history, "append", full)
    log.stored(attempt("store"))
    assert [(severity, code) for severity, code, *_ in notes] == [
        ("info", "config-stored"),
        ("warning", "config-history-failed"),
    ]


def full_disk(*_: object, **__: object) -> None:
    raise OSError(errno.ENOSPC, "No space left on device")


def test_the_intent_is_in_the_history_before_the_master_is_asked(log, history):
    begun = attempt()
    log.begun(begun)
    (record,) = history.records()
    assert (record.number, record.result, record.after) == (1, BEGUN, HOTTER)
    log.written(begun, [])
    (record,) = history.records()
    assert (record.number, record.result, record.is_genuine) == (1, "done", True)
    log.begun(attempt())
    assert [(each.number, each.result) for each in history.records()] == [(1, "done"), (2, BEGUN)]


def test_where_the_history_takes_no_intent_the_write_is_refused(log, notes, monkeypatch):
    monkeypatch.setattr(JsonLines, "append", full_disk)
    with pytest.raises(RecordingFailed, match="No space left"):
        log.begun(attempt())
    assert [(severity, code) for severity, code, _, _ in notes] == [("warning", "config-history-failed")]


def test_a_disk_that_is_full_at_the_end_leaves_the_intent_until_it_takes_the_outcome(log, notes, history, monkeypatch):
    begun = attempt()
    log.begun(begun)
    with monkeypatch.context() as full:
        full.setattr(JsonLines, "append", full_disk)
        log.written(begun, [])
        assert [record.result for record in history.records()] == [BEGUN]
    assert "config-history-failed" in [code for _, code, _, _ in notes]
    until(lambda: [record.result for record in history.records()] == ["done"])


class HangingDisk:
    """Takes nothing until it is let go."""

    def __init__(self, monkeypatch):
        self.go_on, real = threading.Event(), JsonLines.append

        def append(*args, **kwargs):
            assert self.go_on.wait(WAIT_S)
            real(*args, **kwargs)

        monkeypatch.setattr(JsonLines, "append", append)


def results(history):
    return [(record.source, record.result, record.is_genuine) for record in history.records()]


def test_a_disk_that_hangs_refuses_an_intent_within_a_second_and_its_late_record_says_so(log, history, monkeypatch):
    disk, began_s = HangingDisk(monkeypatch), time.monotonic()
    for _ in range(3):
        with pytest.raises(RecordingFailed, match="not written within"):
            log.begun(attempt())
    assert time.monotonic() - began_s < 3 * 1.0
    disk.go_on.set()
    until(lambda: results(history))
    log.close()
    assert results(history) == [("draft", "nothing was changed: the disk was too slow", True)], "the others never began"


@pytest.mark.parametrize("stall", ["hangs", "full"])
def test_what_is_needed_waits_for_no_disk_and_is_written_afterwards(log, history, monkeypatch, stall):
    done = []
    with monkeypatch.context() as stalled:
        disk = HangingDisk(stalled) if stall == "hangs" else stalled.setattr(JsonLines, "append", full_disk)
        began_s = time.monotonic()
        for name in ("charge-stop", "clear-faults"):
            with log.signed("anna", "command", name, is_needed=True):
                done.append(name)
        assert time.monotonic() - began_s < 2 * 1.0
        assert done == ["charge-stop", "clear-faults"]
        if stall == "hangs":
            with pytest.raises(RecordingFailed):
                log.begun(attempt())
            disk.go_on.set()
    until(lambda: results(history) == [(name, "done", True) for name in done])
    assert {record.t_wall_ns for record in history.records()} == {5 * 10**9}


def test_what_cannot_be_written_before_the_end_is_named(log, history, monkeypatch, caplog):
    monkeypatch.setattr(JsonLines, "append", full_disk)
    with log.signed("anna", "command", "charge-stop", is_needed=True):
        pass
    log.close()
    assert "2 records are not in the signed log" in caplog.text


def test_records_are_read_while_another_waits_for_the_disk(log, history, monkeypatch):
    log.note("anna", "command", "first")
    disk = HangingDisk(monkeypatch)
    log.note("anna", "command", "second")
    assert [record.source for record in history.records()] == ["first"]
    disk.go_on.set()
    log.close()
    assert [record.source for record in history.records()] == ["first", "second"]


def test_an_attempt_that_begun_and_asked_nothing_has_an_outcome_too(log, history):
    begun = attempt()
    log.begun(begun)
    log.failed(begun, NotNow("too many wait"), None)
    assert [record.result for record in history.records()] == ["nothing was changed: too many wait"]
