"""Events go into the log, onto the console and to the subscribers; with the master's uptime while it is live."""

import pytest

from app.service.events import Events
from app.sessions.event_log import EventLog
from app.sources.items import LinkChange
from app.telemetry import Event


@pytest.fixture
def events(tmp_path, clock):
    made = Events(EventLog(tmp_path / "events.sqlite", clock), clock)
    yield made
    made.store.close()


def test_a_note_is_logged_with_the_time_of_the_clock_and_who(events, clock, caplog):
    caplog.set_level("INFO")
    events.note("info", "command", "reset", "anna")
    (logged,) = events.store.query()
    assert (logged.t_wall_ns, logged.code, logged.text, logged.who) == (clock.wall_ns(), "command", "reset", "anna")
    assert "command: reset" in caplog.text


def test_subscribers_get_every_event_in_order(events):
    first, second = [], []
    events.subscribe(first.append)
    events.subscribe(second.append)
    events.note("warning", "a", "one")
    events.add(Event(7, "trip", "b", "two", cell=3, value=4.3, limit=4.2, unit="V"))
    assert [event.code for event in first] == ["a", "b"]
    assert first == second


def test_events_carry_the_masters_uptime_while_rs232_is_live(events, bench, clock, master):
    events.note("info", "before", "nobody speaks")
    bench.feed(LinkChange(0, 0, "rs232", "open"), master.frame())
    events.on_output(bench.outputs[-1], clock.monotonic_ns())
    events.note("info", "while", "it speaks")
    clock.advance(60)
    bench.live.step(0.0)
    events.on_output(bench.outputs[-1], clock.monotonic_ns())
    events.note("info", "after", "it was silent for a minute")
    uptimes = {event.code: event.uptime_ms for event in events.store.query()}
    assert uptimes["before"] is None
    assert uptimes["while"] == master.uptime_ms
    assert uptimes["after"] is None


def test_what_the_pipeline_found_is_logged(events, bench, clock, master):
    bench.feed(master.frame())
    found = bench.outputs[-1]
    events.on_output(type(found)(events=(Event(1, "watch", "x", "found"),)), 0)
    assert [event.code for event in events.store.query()] == ["x"]
