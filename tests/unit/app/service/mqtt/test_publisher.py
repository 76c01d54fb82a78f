"""What of a snapshot is published."""

import json
from dataclasses import replace
from types import SimpleNamespace

import pytest

from app.service.mqtt.broker import parse_broker
from app.service.mqtt.cars import MOST_BYTES, Car
from app.service.mqtt.publisher import NAME_CONFLICT_S, MqttPublisher, event_body, messages
from app.sources.items import LinkChange
from app.telemetry import Alarm, Event
from app.telemetry.encoding import aged
from app.telemetry.service_state import RecordingState
from app.words import Message
from tests.fake_clock import FakeClock

EVENT = Event(1, "info", "noted", Message("verbatim", text="noted"))


def test_a_snapshot_is_published_in_parts_and_what_is_missing_is_null(bench, master):
    master.set("v", [0 if i == 5 else 37000 + i for i in range(96)])
    bench.feed(LinkChange(0, 0, "rs232", "open"), master.frame())
    recording = RecordingState("s1", 5_500_000_000, 7, 4096)
    bodies = {topic: json.loads(body) for topic, body in messages(bench.live.snapshot, recording)}
    assert set(bodies) == {
        *("accumulator", "master", "links", "alarms", "recording"),
        *(f"cells/{name}" for name in ("voltage_v", "temperature_degc", "soc", "soc_sigma")),
    }
    assert bodies["accumulator"]["current_a"] == pytest.approx(10.0)
    assert bodies["cells/voltage_v"]["values"][5:7] == [None, pytest.approx(3.7006)]
    assert bodies["links"]["rs232"]["state"] == "live"
    assert bodies["cells/voltage_v"]["age_s"] == bodies["accumulator"]["age_s"]["voltage"]
    assert (bodies["recording"]["session_id"], bodies["recording"]["since"]) == ("s1", 5.5)


def test_a_total_without_all_cells_is_published_as_the_least_it_can_be(bench, master):
    master.set("v", [0xFFFF if i in range(36, 48) else 37000 for i in range(96)])
    master.set("v_tot", [31080])
    bench.feed(LinkChange(0, 0, "rs232", "open"), master.frame())
    body = dict(messages(bench.live.snapshot, None))["accumulator"]
    total = json.loads(body)
    assert (total["voltage_v"], total["power_w"], total["voltage_mean_v"], total["voltage_delta_v"]) == (None,) * 4
    assert (total["voltage_at_least_v"], total["loaded_cells"]) == (pytest.approx(310.8), 84)
    car = Car("red")
    car.take("accumulator", body, 1.0, is_retained=False)
    shown = car.shown(1.0, 1.0)
    assert (shown["voltage_v"], shown["voltage_at_least_v"]) == (None, pytest.approx(310.8))


def test_what_a_silent_car_last_measured_is_published_with_its_time_and_shown_with_its_age(bench, master):
    bench.feed(LinkChange(0, 0, "rs232", "open"), master.frame())
    live = bench.live.snapshot
    for body in dict(messages(live, None)).values():
        document = json.loads(body)
        assert isinstance(document, list) or not document or document.get("last_known") is None
    t_ns = live.t_mono_ns + 180 * 10**9
    blank = bench.pipeline.tick(t_ns, live.t_wall_ns + 180 * 10**9).snapshot
    bodies = dict(messages(blank, None, {"run": "a", "s": t_ns / 1e9}))
    total, volts = json.loads(bodies["accumulator"]), json.loads(bodies["cells/voltage_v"])
    assert (total["voltage_v"], total["current_a"], volts["values"]) == (None, None, [None] * 96)
    assert total["last_known"]["voltage_v"]["value"] == pytest.approx(live.accumulator.voltage_v)
    assert total["time"] - volts["last_known"]["time"] == pytest.approx(180, abs=0.1)
    assert volts["last_known"]["values"] == pytest.approx(live.cells.voltage_v.tolist())
    car = Car("red")
    car.take("accumulator", bodies["accumulator"], 50.0, is_retained=False)
    shown = car.shown(52.0, 1000.0)
    assert (shown["state"], shown["voltage_v"], shown["voltage_min_v"]) == ("silent", None, None)
    last = shown["last_known"]["voltage_min_v"]
    assert (last["value"], last["cell"]) == (pytest.approx(3.7), 0)
    assert (last["age_s"], last["since"]) == (pytest.approx(182, abs=0.1), pytest.approx(818, abs=0.1))
    late = Car("red")
    late.take("accumulator", bodies["accumulator"], 50.0, is_retained=True)  # kept by the broker, nobody knows how long
    last = late.shown(52.0, 1000.0)["last_known"]["voltage_min_v"]
    assert (last["age_s"], last["since"]) == (None, volts["last_known"]["time"])


@pytest.mark.parametrize("last", [None, [], {"voltage_v": 3}, {"voltage_v": {"value": "x", "time": 1}}, {"soc": {}}])
def test_last_values_that_are_none_are_left_out(last):
    car = Car("red")
    body = json.dumps({"time": 1.0, "sent": {"run": "a", "s": 1.0}, "last_known": last}).encode()
    car.take("accumulator", body, 1.0, is_retained=False)
    assert car.shown(1.0, 1.0)["last_known"] == {}


def test_without_a_recording_its_topic_is_null(bench, master):
    bench.feed(master.frame())
    assert dict(messages(bench.live.snapshot, None))["recording"] == b"null"


def test_a_simulated_car_is_marked_in_every_object(bench, master):
    bench.feed(LinkChange(0, 0, "rs232", "open"), master.frame())
    recording = RecordingState("s1", 5_500_000_000, 7, 4096)
    alarm = Alarm(1, "cell-overtemperature", "trip", Message("cell-overtemperature"), 0, True)
    for source in ("simulator", "serial"):
        snapshot = replace(bench.live.snapshot, source=source, alarms=(alarm,))
        bodies = {topic: json.loads(body) for topic, body in messages(snapshot, recording)}
        marked = [*bodies.pop("alarms"), *bodies.values(), json.loads(event_body(EVENT, source))]
        assert [body["simulated"] for body in marked] == [source == "simulator"] * len(marked)


def test_what_is_older_than_a_second_is_stale(bench, master):
    bench.feed(LinkChange(0, 0, "rs232", "open"), master.frame())
    snapshot = bench.live.snapshot
    for waited_s, stale in ((0.5, False), (2.0, True)):
        later = aged(snapshot, snapshot.t_mono_ns + round(waited_s * 1e9))
        bodies = {topic: json.loads(body) for topic, body in messages(later, None)}
        assert bodies["cells/soc"]["stale"] is bodies["accumulator"]["stale"]["voltage"] is stale
        assert bodies["cells/voltage_v"]["age_s"] == pytest.approx(waited_s, abs=0.01)


def test_another_service_under_the_same_name_is_told_until_it_is_gone():
    clock = FakeClock()
    publisher = MqttPublisher(parse_broker("mqtt://pit/fsg/red"), lambda: None, clock)
    publisher._problem = None  # as when the broker answers

    def hear(body, *, retain=False):
        publisher._on_own_topic(None, None, SimpleNamespace(payload=body, retain=retain))
        return None if publisher.problem is None else publisher.problem.args["problem"].code

    def of(run):
        return json.dumps({"sent": {"run": run, "s": 1.0}}).encode()

    own = of(publisher._clock_run.id)
    told = [hear(own), hear(of("x"), retain=True), hear(b"{"), hear(b"[]"), hear(of("x")), hear(own)]
    assert told == [None] * 6  # one message may be the last word of the run before
    assert hear(of("x").ljust(MOST_BYTES + 1)) is None  # what is larger than any of ours is not even read
    assert hear(of("x")) == "mqtt-twice"
    clock.advance(NAME_CONFLICT_S + 1)
    assert hear(own) is None
