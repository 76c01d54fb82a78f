"""The service's own threads, fed by hand: what fails says so, and everything else goes on."""

import time
from dataclasses import replace

import pytest

from app.errors import ConfigError, NotNow
from app.service.runtime import Runtime
from app.service.settings import Settings
from app.telemetry import CanItem


@pytest.fixture
def runtime(tmp_path):
    made = Runtime(
        Settings(data=tmp_path, record=False, filter="coulomb"), serial_url=None, can_url=None, source="serial"
    )
    made.start()
    yield made
    made.stop()


def wait(condition, seconds=10.0):
    deadline = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < deadline
        time.sleep(0.005)
    return found


def now(item):
    """The item as if it had just arrived."""
    return replace(item, t_mono_ns=time.monotonic_ns(), t_wall_ns=time.time_ns())


def fresh(runtime):
    snapshot = runtime.latest()
    return snapshot if snapshot is not None and snapshot.is_fresh else None


def test_what_is_put_in_is_shown(runtime, master):
    runtime.put(now(master.frame()))
    assert wait(lambda: fresh(runtime)).cells.voltage_v[3] == pytest.approx(3.7003)
    assert len(runtime.history.read(900, None)["time"]) == 1


def test_without_items_there_is_a_snapshot_a_second(runtime):
    first = wait(runtime.latest)
    second = wait(lambda: runtime.latest() if runtime.latest() is not first else None)
    assert not second.is_fresh
    assert runtime.degraded() == []


def test_an_item_that_fails_is_counted_and_the_next_is_taken(runtime, master, monkeypatch, caplog):
    feed = runtime.pipeline.feed
    monkeypatch.setattr(runtime.pipeline, "feed", lambda item: 1 / 0 if isinstance(item, CanItem) else feed(item))
    for _ in range(20):
        runtime.put(CanItem(1, 1, 1, b""))
    runtime.put(now(master.frame()))
    wait(lambda: fresh(runtime))
    assert any("ZeroDivisionError" in reason and "20 item" in reason for reason in runtime.degraded())
    assert len([record for record in caplog.records if record.levelname == "ERROR"]) == 1


def test_a_recorder_that_fails_does_not_take_the_picture_away(runtime, master, monkeypatch):
    monkeypatch.setattr(runtime.recorder, "on_item", lambda item: 1 / 0)
    runtime.put(now(master.frame()))
    assert wait(lambda: fresh(runtime))
    assert any("ZeroDivisionError" in reason for reason in runtime.degraded())


def test_a_pipeline_that_stands_still_is_not_well(runtime):
    snapshot = wait(runtime.latest)
    runtime.pipeline_snapshot = replace(snapshot, t_mono_ns=snapshot.t_mono_ns - 60 * 10**9)
    assert any("stands still" in reason for reason in runtime.degraded()) or runtime.pipeline_snapshot is not snapshot


def test_what_was_read_back_counts_until_the_stream_brings_newer(runtime, master):
    runtime.configuration.last_read = time.monotonic_ns(), b"\1" * 420
    assert runtime.config_in_force() == b"\1" * 420
    assert runtime.config_age_s() < 10
    runtime.put(now(master.config()))
    runtime.put(now(master.frame()))
    wait(lambda: fresh(runtime))
    assert runtime.config_in_force() == bytes(master.image[:420])


def test_the_alarms_of_a_replay_are_not_the_cars(runtime, monkeypatch):
    assert not runtime.acknowledge_alarm(1, "anna")
    monkeypatch.setattr(type(runtime.replaying), "is_active", True)
    with pytest.raises(NotNow):
        runtime.acknowledge_alarm(1, "anna")


def test_events_carry_the_masters_clock_while_it_speaks(runtime, master):
    runtime.note("info", "before", "nobody speaks")
    runtime.put(now(master.frame()))
    wait(lambda: fresh(runtime))
    by_code = {event.code: event for event in runtime.events.query(0, 10, None, None)}
    assert by_code["before"].uptime_ms is None


def test_stopping_is_quick_also_with_an_inbox_that_is_full(tmp_path, master, monkeypatch):
    monkeypatch.setattr("app.service.runtime.INBOX_ITEMS", 2)
    runtime = Runtime(Settings(data=tmp_path, record=False), serial_url=None, can_url=None, source="serial")
    for _ in range(2):
        runtime.put(now(master.frame()))
    runtime.start()
    started = time.monotonic()
    runtime.stop()
    assert time.monotonic() - started < 4
    runtime.put(now(master.frame()))  # nobody is left to take it: returns at once


def test_a_cell_that_is_none_stops_the_start(tmp_path):
    with pytest.raises(ConfigError, match="no-such-cell"):
        Runtime(Settings(data=tmp_path, cell="no-such-cell"), serial_url=None, can_url=None, source="serial")
