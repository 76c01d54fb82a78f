"""Health asks every part that can fail."""

from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace

import pytest

from app.service import pipeline_thread
from app.service.health.checks import DamagedFiles, Health
from app.sources.items import LinkChange
from app.words import Message, Quantity


@dataclass
class FakeParts:
    recorder: SimpleNamespace = field(
        default_factory=lambda: SimpleNamespace(
            status=SimpleNamespace(error=None, warning=None), start_failure=None, stuck=lambda: []
        )
    )
    events: SimpleNamespace = field(default_factory=lambda: SimpleNamespace(store=SimpleNamespace(error=None)))
    mqtt: SimpleNamespace = field(default_factory=lambda: SimpleNamespace(problem=None))
    damaged: DamagedFiles = field(default_factory=DamagedFiles)
    load: SimpleNamespace = field(default_factory=lambda: SimpleNamespace(problem=None))
    stuck_links: list[Message] = field(default_factory=list)


@pytest.fixture
def parts():
    return FakeParts()


@pytest.fixture
def health(bench, parts, clock):
    links = SimpleNamespace(stuck=lambda: parts.stuck_links)
    return Health(bench.live, links, parts.recorder, parts.events, parts.mqtt, clock, parts.load, parts.damaged)


@pytest.fixture
def live(bench, master):
    """A link that delivers."""
    bench.feed(LinkChange(0, 0, "rs232", "open"), master.frame())
    return bench


def told(health):
    """(problems, failures, stalls) by their codes."""
    return tuple([m.code for m in found] for found in (health.problems(), health.failures(), health.stalls()))


def test_before_the_first_snapshot_that_is_the_problem(health):
    assert told(health) == (["no-snapshot"], [], [])


def test_all_is_well(health, live):
    assert told(health) == ([], [], [])


def test_a_link_that_is_lost_fails_and_no_restart_helps(health, live, master):
    live.feed(LinkChange(0, 0, "rs232", "lost", "unplugged"), master.frame())
    assert health.problems() == [Message("rs232-lost", error="unplugged")]
    assert told(health) == (["rs232-lost"], ["rs232-lost"], [])


def test_a_master_that_falls_silent_fails_and_no_restart_helps(health, live, clock):
    clock.advance(5)
    live.live.step(0.0)
    assert told(health) == (["rs232-silent"], ["rs232-silent"], [])


def test_a_full_disk_fails_and_no_restart_helps(health, live, parts):
    parts.recorder.status.error = Message("disk-full", kept=Quantity(100, "MB"))
    assert told(health) == (["disk-full"], ["disk-full"], [])


def test_a_recording_that_cannot_begin_fails(health, live, parts):
    parts.recorder.start_failure = Message("disk-refuses", error="no such folder")
    assert told(health) == (["disk-refuses"], ["disk-refuses"], [])


def test_a_disk_that_hangs_fails_and_a_restart_would_lose_what_waits(health, live, parts):
    parts.recorder.status.error = Message("disk-silent", time=Quantity(30, "s", 0))
    assert told(health) == (["disk-silent"], ["disk-silent"], [])


def test_a_recorder_that_has_ended_is_a_stall(health, live, parts):
    parts.recorder.status.error = ended = Message("disk-silent", time=Quantity(30, "s", 0))
    parts.recorder.stuck = lambda: [ended]
    assert told(health) == (["disk-silent"], ["disk-silent"], ["disk-silent"])


def test_a_link_whose_driver_hangs_is_a_stall(health, live, parts):
    parts.stuck_links.append(Message("can-stuck", time=Quantity(30, "s", 0)))
    assert told(health) == (["can-stuck"], ["can-stuck"], ["can-stuck"])


def test_a_pipeline_that_hangs_in_an_item_fails_at_once_and_is_a_stall_later(health, live, clock):
    clock.advance(pipeline_thread.STALL_S + 1)
    assert told(health) == (["no-snapshot-for"], ["no-snapshot-for"], [])
    clock.advance(pipeline_thread.STUCK_S)
    assert told(health)[2] == ["no-snapshot-for"]


def test_a_pipeline_that_hangs_is_named_once_although_its_seconds_go_on(health, live, clock, monkeypatch):
    live.live.step(0.0)
    clock.advance(pipeline_thread.STUCK_S + 1)
    now_ns = clock.monotonic_ns

    def later():
        clock.advance(0.6)
        return now_ns()

    monkeypatch.setattr(clock, "monotonic_ns", later)
    assert told(health)[:2] == (["no-snapshot-for"], ["no-snapshot-for"])


def test_what_is_not_the_batterys_is_missing_and_fails_nothing(health, live, parts):
    parts.recorder.status.warning = Message("disk-low")
    parts.events.store.error = Message("events-wait")
    parts.mqtt.problem = Message("no-broker")
    assert told(health) == (["disk-low", "events-wait", "no-broker"], [], [])


def test_uptime_counts_from_the_start(health, clock):
    clock.advance(12.5)
    assert health.uptime_s == pytest.approx(12.5)


def test_what_is_left_out_for_the_recorder_is_missing_and_no_failure(health, live, parts):
    parts.load.problem = Message("shed-pages")
    assert told(health) == (["shed-pages"], [], [])


def test_a_file_that_was_set_aside_is_a_problem_and_no_failure(health, live, parts):
    parts.damaged.add(Path("events.sqlite"), Path("events.sqlite.damaged-20260101T000000Z"))
    assert told(health) == (["file-set-aside"], [], [])
    notes = []
    parts.damaged.note_into(lambda *note: notes.append(note))
    assert [(severity, code) for severity, code, _ in notes] == [("warning", "file-set-aside")]
    parts.damaged.add(Path("blackboxes.sqlite"), Path("kept"))
    assert len(notes) == 2
