"""Failures are counted, logged at most once a second, and news for a minute."""

from app.service.failures import SHOWN_S, Failures
from app.words import Message
from tests.fake_clock import FakeClock


def test_without_a_failure_there_is_no_reason():
    assert Failures(FakeClock()).reason is None


def test_many_failures_at_once_are_one_line_of_the_log(caplog):
    failures = Failures(FakeClock())
    for _ in range(20):
        failures.add(ZeroDivisionError("by zero"))
    assert failures.reason == Message("pipeline-failed", n=20, error="ZeroDivisionError: by zero")
    assert len(caplog.records) == 1


def test_a_failure_a_second_later_is_logged_again(caplog):
    clock = FakeClock()
    failures = Failures(clock)
    failures.add(ValueError("first"))
    clock.advance(1.1)
    failures.add(ValueError("second"))
    assert len(caplog.records) == 2


def test_after_a_minute_a_failure_is_no_news():
    clock = FakeClock()
    failures = Failures(clock)
    failures.add(ValueError("once"))
    clock.advance(SHOWN_S - 0.1)
    assert failures.reason is not None
    clock.advance(0.2)
    assert failures.reason is None


def test_work_that_fails_is_counted_and_goes_on():
    failures = Failures(FakeClock())
    done = []

    def work(value):
        done.append(10 // value)

    safe = failures.caught(work)
    for value in (5, 0, 2):
        safe(value)
    assert done == [2, 5]
    assert failures.reason.code == "pipeline-failed"
