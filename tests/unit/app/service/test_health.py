"""Health asks every part that can fail."""

from dataclasses import dataclass, field
from types import SimpleNamespace

import pytest

from app.service.health import Health
from app.sources.items import LinkChange
from app.words import Message


@dataclass
class FakeParts:
    recorder: SimpleNamespace = field(
        default_factory=lambda: SimpleNamespace(status=SimpleNamespace(error=None, warning=None))
    )
    events: SimpleNamespace = field(default_factory=lambda: SimpleNamespace(store=SimpleNamespace(error=None)))
    mqtt: SimpleNamespace = field(default_factory=lambda: SimpleNamespace(problem=None))


@pytest.fixture
def parts():
    return FakeParts()


@pytest.fixture
def health(bench, parts, clock):
    return Health(bench.live, parts.recorder, parts.events, parts.mqtt, clock)


def test_before_the_first_snapshot_that_is_the_problem(health):
    assert health.problems() == [Message("no-snapshot")]


def test_a_link_that_is_lost_is_named_with_its_error(health, bench, master):
    bench.feed(LinkChange(0, 0, "rs232", "open"), master.frame())
    assert health.problems() == []
    bench.feed(LinkChange(0, 0, "rs232", "lost", "unplugged"), master.frame())
    assert health.problems() == [Message("rs232-lost", error="unplugged")]


def test_every_part_that_fails_is_named(health, bench, parts, master):
    bench.feed(LinkChange(0, 0, "rs232", "open"), master.frame())
    parts.recorder.status.warning = "disk nearly full"
    parts.events.store.error = "events wait"
    parts.mqtt.problem = "no broker"
    assert health.problems() == ["disk nearly full", "events wait", "no broker"]
    parts.recorder.status.error = "disk full"
    assert health.problems()[0] == "disk full"


def test_uptime_counts_from_the_start(health, clock):
    clock.advance(12.5)
    assert health.uptime_s == pytest.approx(12.5)
