"""What the links deliver is shown, recorded and judged; one item or listener that fails costs only itself."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from app.errors import NotNow
from app.live.load_shedding import ShedLoad
from app.live.pipeline_factory import PipelineFactory
from app.service import pipeline_thread
from app.service.pipeline_thread import STALL_S
from app.sources.items import CanItem
from app.sources.loaded_battery import load_battery
from app.words import Message, render
from tests.unit.app.service.conftest import LiveBench


def fail(*_: object) -> None:
    raise ZeroDivisionError


def test_what_is_put_in_is_shown(bench, master):
    bench.feed(master.frame())
    assert bench.live.hub.latest.cells.voltage_v[3] == pytest.approx(3.7003)
    assert bench.live.snapshot is bench.live.hub.latest
    assert len(bench.live.history.read(900, None)["time"]) == 1
    assert len(bench.items) == 1
    assert bench.outputs[-1].snapshot is bench.live.snapshot


def test_without_items_there_is_a_snapshot_a_second(bench, clock):
    bench.live.step(0.0)
    first = bench.live.snapshot
    clock.advance(0.9)
    bench.live.step(0.0)
    assert bench.live.snapshot is first
    clock.advance(0.2)
    bench.live.step(0.0)
    assert bench.live.snapshot is not first
    assert not bench.live.snapshot.is_fresh
    assert bench.live.problems() == []


def test_a_fresh_snapshot_puts_the_next_tick_off(bench, clock, master):
    bench.feed(master.frame())
    clock.advance(0.9)
    bench.feed(master.frame())
    fresh = bench.live.snapshot
    clock.advance(0.9)
    bench.live.step(0.0)
    assert bench.live.snapshot is fresh


def test_an_item_that_fails_is_counted_and_the_next_is_taken(bench, master, monkeypatch, caplog):
    feed = bench.pipeline.feed
    monkeypatch.setattr(
        bench.pipeline, "feed", lambda item, **how: fail() if isinstance(item, CanItem) else feed(item, **how)
    )
    bench.feed(*[CanItem(1, 1, 1, b"")] * 20)
    bench.feed(master.frame())
    assert bench.live.snapshot.is_fresh
    assert any("ZeroDivisionError" in render(each) and "20 item" in render(each) for each in bench.live.problems())
    assert len([record for record in caplog.records if record.levelname == "ERROR"]) == 1


@pytest.mark.parametrize("kind", ["_on_item", "_on_output"])
def test_a_listener_that_fails_takes_nothing_from_the_others(bench, master, monkeypatch, kind):
    monkeypatch.setattr(bench.live, kind, (fail, *getattr(bench.live, kind)))
    bench.feed(master.frame())
    assert bench.live.hub.latest.is_fresh
    assert len(bench.items) == len(bench.outputs) == 1
    assert any("ZeroDivisionError" in render(each) for each in bench.live.problems())


def test_before_the_first_snapshot_there_is_one_problem(bench):
    assert bench.live.problems() == [Message("no-snapshot")]


def test_a_pipeline_that_stands_still_is_a_problem(bench, clock, master):
    bench.feed(master.frame())
    clock.advance(STALL_S + 1)
    assert any("pipeline is blocked" in render(each) for each in bench.live.problems())


def test_while_a_replay_is_shown_the_cars_snapshots_are_kept_and_not_shown(bench, master):
    bench.replay.is_active = True
    bench.feed(master.frame())
    assert bench.live.hub.latest is None
    assert bench.live.snapshot.is_fresh


def test_the_alarms_of_a_replay_are_not_the_cars(bench):
    assert not bench.live.acknowledge_alarm(1, "anna")
    bench.replay.is_active = True
    with pytest.raises(NotNow):
        bench.live.acknowledge_alarm(1, "anna")


def test_the_thread_works_on_what_is_inside_before_it_ends(bench, master):
    for _ in range(5):
        bench.inbox.put(master.frame())
    bench.live.start()
    bench.live.stop()
    assert len(bench.items) == 5
    bench.inbox.put(master.frame())  # nobody is left to take it: returns at once


def test_a_history_that_fails_takes_nothing_from_the_listeners(bench, master, monkeypatch):
    monkeypatch.setattr(bench.live.history, "add", fail)
    bench.feed(master.frame())
    assert len(bench.outputs) == 1
    assert bench.live.hub.latest.is_fresh
    assert any("ZeroDivisionError" in render(each) for each in bench.live.problems())


def test_what_follows_publishing_is_called_for_new_snapshots_and_not_for_ages(bench, clock, master, monkeypatch):
    published = []
    monkeypatch.setattr(
        bench.live, "_after_publishing", (lambda output, t_mono_ns: published.append(bench.live.hub.latest),)
    )
    bench.feed(master.frame())
    clock.advance(2.0)
    bench.live.step(0.0)
    assert [snapshot.is_fresh for snapshot in published] == [True]


def work_late(bench, clock, master, late_s):
    """Let two seconds of frames wait so long; return what the thread makes of them."""
    for k in range(20):
        now_ns = clock.monotonic_ns() + k * 100_000_000
        bench.inbox.put(replace(master.frame(), t_mono_ns=now_ns, t_wall_ns=clock.wall_ns()))
    clock.advance(2.0 + late_s)
    for _ in range(20):
        bench.live.step(0.0)
    return bench.outputs


def test_a_lag_of_a_second_hides_no_sample_from_the_alarms(bench, clock, master):
    made = work_late(bench, clock, master, -0.5)
    assert sum(output.snapshot is not None and output.snapshot.is_fresh for output in made) == 20


def test_of_what_is_very_late_all_is_estimated_and_the_newest_shown(bench, clock, master):
    made = work_late(bench, clock, master, 10.0)
    assert sum(output.estimates is not None for output in made) == 20
    assert sum(output.snapshot is not None and output.snapshot.is_fresh for output in made) == 1


def test_a_battery_that_speaks_seldom_is_shown_when_its_period_ends_not_at_its_next_frame(clock):
    battery = load_battery("one-signal-a-cell")
    bench = LiveBench(clock, PipelineFactory("coulomb", None, battery).pipeline("can", None, "virtual:x"))
    message = next(each for each in battery.definitions.messages if each.name.startswith("Cell"))
    bench.feed(CanItem(0, 0, message.can_id, b"\x10\x27" * 4))
    assert bench.live.snapshot is None or not bench.live.snapshot.is_fresh
    clock.advance(0.1)
    bench.live.step(0.0)
    assert bench.live.snapshot.is_fresh
    assert bench.live.snapshot.accumulator.loaded_cells > 0


def test_at_the_end_a_full_inbox_is_recorded_to_the_last_item_though_nothing_is_estimated(bench, master, monkeypatch):
    monkeypatch.setattr(pipeline_thread, "DRAIN_S", 0.0)
    for _ in range(500):
        bench.inbox.put(master.frame())
    bench.live.stop()
    bench.live.start()
    bench.live._thread.join(30)
    assert len(bench.items) == 500
    assert bench.live.snapshot is None


@pytest.mark.parametrize(
    ("shed", "shown", "judged"), [(ShedLoad.NOTHING, 5, 5), (ShedLoad.PREDICTION, 5, 0), (ShedLoad.PAGES, 1, 0)]
)
def test_what_is_left_out_for_the_recorder_is_never_an_estimate(bench, clock, master, monkeypatch, shed, shown, judged):
    asked, waits = [], []
    monkeypatch.setattr(bench.pipeline, "predict", lambda: asked.append(True))
    monkeypatch.setattr(
        bench.live, "_load", SimpleNamespace(now=lambda waited_s: shed, shed=lambda took_s: waits.append(True))
    )
    for _ in range(5):
        clock.advance(0.1)
        bench.feed(master.frame())
    assert sum(output.snapshot is not None for output in bench.outputs) == shown
    assert sum(output.estimates is not None for output in bench.outputs) == 5
    assert len(asked) == judged
    assert len(waits) == len(bench.items)  # each lets a commit go first
