import os

import pytest

from app.sessions.catalogue import Catalogue
from app.sessions.recording.recorder import Recorder
from app.sessions.retention import Retention, RetentionRule, apply_rule
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
    apply_rule(catalogue, rule, NOW_NS, told.append)
    assert names(catalogue) == before[:kept]
    assert len(told) == 3 - kept


def test_a_session_that_is_read_is_kept_until_the_next_time(catalogue):
    oldest = catalogue.list()[-1].id
    with catalogue.open(oldest) as file, file.consistent():
        file.markers()
        assert apply_rule(catalogue, RetentionRule(keep_days=50), NOW_NS, lambda _: None) == ()
    assert apply_rule(catalogue, RetentionRule(keep_days=50), NOW_NS, lambda _: None) == (oldest,)


def test_the_thread_applies_the_rule_at_the_start_by_the_clock(catalogue):
    told = []
    retention = Retention(catalogue, RetentionRule(keep_days=50), told.append, FakeClock(wall_s=NOW_NS / 1e9))
    retention.start()
    retention.stop()
    assert len(told) == 1
    assert len(names(catalogue)) == 2


def test_without_a_rule_there_is_no_thread(catalogue):
    retention = Retention(catalogue, RetentionRule(), lambda _: None, FakeClock(wall_s=NOW_NS / 1e9))
    retention.start()
    retention.stop()
    assert len(names(catalogue)) == 3
