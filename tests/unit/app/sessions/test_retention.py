import os

import pytest

from app.sessions.catalogue import Catalogue
from app.sessions.recording.recorder import Recorder
from app.sessions.retention import TRASH_NS, Retention, RetentionRule, apply_rule, clock_problem
from tests.fake_clock import FakeClock, FunctionClock

DAY_NS = 86_400 * 10**9
NOW_NS = 1_790_000_000 * 10**9


@pytest.fixture
def catalogue(tmp_path):
    """Sessions that ended 1, 10 and 100 days ago, a megabyte each."""
    for days in (1, 10, 100):
        wall_ns = NOW_NS - days * DAY_NS
        recorder = Recorder(tmp_path, FunctionClock(lambda: 0, lambda at=wall_ns: at), version="test")
        recorder.start(f"{days} days ago")
        for _ in range(10):
            recorder.frame(0, wall_ns, 0, os.urandom(100_000), False)
        recorder.close()
    return Catalogue(tmp_path)


def names(catalogue):
    return [info.name for info in catalogue.list()]


@pytest.mark.parametrize(
    ("rule", "kept"),
    [
        (RetentionRule(), 3),
        (RetentionRule(keep_days=50), 2),
        (RetentionRule(keep_days=5), 1),
        (RetentionRule(keep_gb=0.0025), 2),
        (RetentionRule(keep_days=50, keep_gb=0.0015), 1),
    ],
)
def test_only_what_the_rule_names_is_deleted_oldest_first(catalogue, rule, kept):
    before, told = names(catalogue), []
    apply_rule(catalogue, rule, NOW_NS, lambda *note: told.append(note))
    assert names(catalogue) == before[:kept]
    assert len(told) == 3 - kept


def test_a_session_that_is_read_is_kept_until_the_next_time(catalogue):
    oldest = catalogue.list()[-1].id
    with catalogue.open(oldest) as file, file.consistent():
        file.markers()
        assert apply_rule(catalogue, RetentionRule(keep_days=50), NOW_NS, lambda *_: None) == []
    assert apply_rule(catalogue, RetentionRule(keep_days=50), NOW_NS, lambda *_: None) == [oldest]


def test_the_thread_applies_the_rule_at_the_start_by_the_clock(catalogue):
    told = []
    retention = Retention(
        catalogue, RetentionRule(keep_days=50), lambda *note: told.append(note), FakeClock(wall_s=NOW_NS / 1e9)
    )
    retention.start()
    retention.stop()
    assert len(told) == 1
    assert len(names(catalogue)) == 2


def test_without_a_rule_there_is_no_thread(catalogue):
    retention = Retention(catalogue, RetentionRule(), lambda *_: None, FakeClock(wall_s=NOW_NS / 1e9))
    retention.start()
    retention.stop()
    assert len(names(catalogue)) == 3


@pytest.mark.parametrize(
    ("days", "is_set", "problem"),
    [
        (0, False, None),
        (-3, False, "clock-behind"),
        (-3, True, "clock-behind"),
        (400, False, "clock-ahead"),
        (400, True, None),
    ],
)
def test_a_clock_is_believed_where_it_goes_with_the_sessions(catalogue, days, is_set, problem):
    found = clock_problem(catalogue, NOW_NS + days * DAY_NS, is_set_by_others=is_set)
    assert (found and found.code.removeprefix("retention-")) == problem


def test_a_clock_that_is_400_days_ahead_deletes_nothing_and_says_so_once(catalogue):
    told = []
    clock = FakeClock(wall_s=(NOW_NS + 400 * DAY_NS) / 1e9)
    retention = Retention(catalogue, RetentionRule(keep_days=50), lambda *note: told.append(note), clock)
    for _ in range(3):
        retention.apply()
    assert len(names(catalogue)) == 3
    assert [(severity, message.code) for severity, message in told] == [("warning", "retention-clock-ahead")]


def test_a_clock_that_the_network_set_wrong_takes_a_part_with_a_word_and_it_can_be_taken_back(catalogue, tmp_path):
    told = []
    apply_rule(catalogue, RetentionRule(keep_days=50), NOW_NS + 400 * DAY_NS, lambda *note: told.append(note))
    assert len(names(catalogue)) == 1
    assert [message.code for _, message in told] == ["retention-much", "session-expired", "session-expired"]
    for path in (tmp_path / ".trash").iterdir():
        path.rename(tmp_path / path.name)
    assert len(names(catalogue)) == 3


def test_the_trash_is_emptied_later_or_where_the_disk_is_full(catalogue, tmp_path):
    apply_rule(catalogue, RetentionRule(keep_days=5), NOW_NS, lambda *_: None)
    trash = tmp_path / ".trash"
    first, second = sorted(trash.iterdir())
    os.utime(first, ns=(NOW_NS - TRASH_NS, NOW_NS - TRASH_NS))
    catalogue.empty_trash(NOW_NS - TRASH_NS + 1, 0)
    assert list(trash.iterdir()) == [second]
    catalogue.empty_trash(0, 1 << 62)
    assert list(trash.iterdir()) == []
