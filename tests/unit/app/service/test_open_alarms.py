"""Neither the end of the service nor its start ends an alarm, whatever is measured meanwhile."""

from dataclasses import replace

import pytest

from app.live.open_alarms import load_open_alarms, save_open_alarms
from app.live.pipeline_factory import PipelineFactory
from app.service.learned_state_saver import learning_pipeline
from app.telemetry import TripCause
from app.telemetry.events import PossibleCause
from app.words import Message, Pack, condition, render
from firmware_protocol.messages import EventCode, EventMessage, MessageType
from tests.service_process import until

LOW = [*[37000] * 40, 24000, *[37000] * 55]
CAUSE = TripCause(
    "joint-resistance-high",
    condition("joint-resistance-high"),
    40,
    3,
    0.9,
    (PossibleCause("capacity-low", condition("capacity-low"), 40, 3, 0.1),),
    size=0.014,
    low=0.0128,
    high=0.0152,
    unit="ohm",
    since=1.7e9,
    judged=1.7e9 + 5,
    revised=True,
)


class Service:
    """The pipeline of a service, and what it saves."""

    def __init__(self, data, clock, master, source="serial"):
        self.clock, self.master = clock, master
        self.pipeline, self.saver = learning_pipeline(data, PipelineFactory("coulomb"), clock, source, "/dev/x", None)
        self.snapshot, self.events = None, []

    def drive(self, seconds):
        self.feed(self.master.config())
        for _ in range(round(10 * seconds)):
            self.clock.advance(0.1)
            self.feed(self.master.frame())
            self.pipeline.predict()
        return self

    def feed(self, item):
        item = replace(item, t_mono_ns=self.clock.monotonic_ns(), t_wall_ns=self.clock.wall_ns())
        self._take(self.pipeline.feed(item))

    def wait(self, seconds):
        for _ in range(round(seconds)):
            self.clock.advance(1)
            self._take(self.pipeline.tick(self.clock.monotonic_ns(), self.clock.wall_ns()))
        return self

    def _take(self, output):
        self.saver.on_output(output, self.clock.monotonic_ns())
        self.saver.on_alarms(output, self.clock.monotonic_ns())
        self.snapshot, self.events = output.snapshot or self.snapshot, [*self.events, *output.events]

    def alarm(self, code):
        return next((each for each in self.snapshot.alarms if each.code == code), None)


@pytest.fixture
def start(tmp_path, clock, master):
    return lambda source="serial": Service(tmp_path, clock, master, source)


@pytest.mark.parametrize("is_killed", [True, False])
def test_a_trip_is_open_after_a_restart_until_a_measurement_ends_it(start, master, tmp_path, is_killed):
    trip = EventMessage(EventCode.TRIP_V_MIN, 0, 40, 24_000, 25_000)
    master.set("v", LOW)
    before = start()
    before.feed(master.item(MessageType.EVENT, trip.to_body()))
    master.set("status.flags", [0])
    before.drive(2)
    known = before.alarm("master-fault")
    assert before.pipeline.acknowledge(known.id, "anna")
    before.pipeline.explain(CAUSE)
    before.drive(2)
    file = tmp_path / "alarms-cells.json"
    if is_killed:
        until(lambda: b"capacity-low" in file.read_bytes() and b"anna" in file.read_bytes())
    else:
        before.saver.save()
    after = start().wait(60)
    silent = after.alarm("master-fault")
    assert silent == before.alarm("master-fault")
    assert (silent.id, silent.active, silent.acknowledged_by, silent.cause) == (known.id, True, "anna", CAUSE)
    assert after.alarm("cell-undervoltage").since_ns == before.alarm("cell-undervoltage").since_ns
    after.drive(5)  # it is still open; the reason came before the service did
    assert after.alarm("master-fault") == silent
    master.set("v", [37000] * 96)
    master.set("status.flags", [0b100000001])
    after.drive(5)
    assert after.alarm("master-fault") is None
    assert not after.alarm("cell-undervoltage").active
    assert [event.message.code for event in after.events if event.code == "master-fault"] == ["alarm-ended"]


def test_an_alarm_of_a_finding_is_open_after_a_kill(start, master, tmp_path):
    master.set("t", [*[25] * 5, -128, *[25] * 90])
    before = start().drive(20)
    known = before.alarm("temperature-sensor-open")
    until(lambda: (tmp_path / "cells.npz").exists() and (tmp_path / "alarms-cells.json").exists())
    before.saver.on_alarms(before.pipeline.tick(before.clock.monotonic_ns(), before.clock.wall_ns()), 0)
    until(lambda: [each.id for each in load_open_alarms(tmp_path / "alarms-cells.json", 96, 8)] == [known.id])
    after = start().wait(30)
    assert after.alarm("temperature-sensor-open").active
    assert after.drive(15).alarm("temperature-sensor-open").id == known.id


def test_an_alarm_that_ended_and_nobody_saw_is_there_after_a_restart(start, master):
    master.set("v", LOW)
    before = start().drive(2)
    master.set("v", [37000] * 96)
    before.drive(5)
    before.saver.save()
    ended = start().wait(30).alarm("cell-undervoltage")
    assert (ended.active, ended.ended_ns) == (False, before.alarm("cell-undervoltage").ended_ns)


def test_a_simulated_car_and_a_real_one_have_no_alarm_in_common(start, master):
    master.set("v", LOW)
    start("simulator").drive(2).saver.save()
    assert start().wait(5).snapshot.alarms == ()


@pytest.mark.parametrize(
    "content",
    [b"", b"{", b"[]", b'{"alarms": 3}', b'{"alarms": [{}]}', b'{"alarms": [{"code": 1, "cause": null, "cells": []}]}'],
)
def test_a_damaged_file_is_no_alarm(tmp_path, content):
    (tmp_path / "a.json").write_bytes(content)
    assert load_open_alarms(tmp_path / "a.json", 96, 8) == ()


def test_what_is_kept_is_read_again_but_for_cells_that_there_are_not(start, master, tmp_path):
    master.set("v", LOW)
    alarms = start().drive(2).snapshot.alarms
    save_open_alarms(tmp_path / "a.json", alarms)
    assert load_open_alarms(tmp_path / "a.json", 96, 8) == alarms
    assert load_open_alarms(tmp_path / "a.json", 40, 8) == ()
    lost = replace(
        alarms[0], code="slave-lost", cell=None, message=Message("slave-lost-in-packs", n=1, packs=(Pack(7),))
    )
    save_open_alarms(tmp_path / "a.json", [lost])
    assert load_open_alarms(tmp_path / "a.json", 96, 8) == (lost,)
    assert load_open_alarms(tmp_path / "a.json", 96, 6) == ()  # the same cells in fewer packs
    assert render(alarms[0].message, [12] * 8) == "cell undervoltage"
