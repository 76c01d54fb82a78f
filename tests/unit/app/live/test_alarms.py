from dataclasses import replace

import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.estimators import make_estimator
from app.live.alarms import AlarmTracker
from app.live.pipeline import Pipeline
from app.sources.items import LinkChange
from app.sources.master.source import MasterSource
from app.telemetry import TripCause
from app.words import Message, Pack, condition, render
from firmware_protocol.messages import EventCode, EventMessage, MessageType

CELL = load_cell("samsung-25r-10p")


@pytest.fixture
def pipeline(master):
    chain = Pipeline(
        MasterSource("serial", "/dev/x"),
        lambda: make_estimator("coulomb", CELL, 96),
        filter_name="coulomb",
        cell_name="c",
    )
    chain.feed(LinkChange(0, 0, "rs232", "open"))
    chain.feed(master.config())
    return chain


def run(pipeline, master, seconds):
    """Frames at 10 Hz; returns the last snapshot and all events."""
    events, snapshot = [], None
    for _ in range(round(seconds * 10)):
        output = pipeline.feed(master.frame())
        events += output.events
        snapshot = output.snapshot
    return snapshot, events


def codes(snapshot, *, active=True):
    return {alarm.code for alarm in snapshot.alarms if alarm.active == active}


def test_one_sample_raises_nothing(pipeline, master):
    run(pipeline, master, 1)
    master.set("v", [20000, *[37000] * 95])
    snapshot, events = run(pipeline, master, 0.1)
    assert not codes(snapshot)
    assert not events


def test_a_trip_is_raised_with_its_cell_value_and_limit_and_once(pipeline, master):
    master.set("v", [*[37000] * 40, 24000, *[37000] * 55])
    snapshot, events = run(pipeline, master, 3)
    alarm = next(a for a in snapshot.alarms if a.code == "cell-undervoltage")
    assert (alarm.severity, alarm.cell, alarm.value, alarm.limit) == ("trip", 40, pytest.approx(2.4), 2.5)
    assert [e.code for e in events].count("cell-undervoltage") == 1


def test_the_masters_trip_names_the_cell_the_value_and_the_limit_of_its_reason(pipeline, master):
    trip = EventMessage(EventCode.TRIP_V_MAX, 0, 63, 42969, 42000)
    pipeline.feed(master.item(MessageType.EVENT, trip.to_body()))
    master.set("status.flags", [0])
    snapshot, _ = run(pipeline, master, 1)
    alarm = next(a for a in snapshot.alarms if a.code == "master-fault")
    assert render(alarm.message, [12] * 8) == "shutdown circuit open: cell overvoltage"
    assert (alarm.cell, alarm.value, alarm.limit, alarm.unit) == (63, pytest.approx(4.2969), pytest.approx(4.2), "V")


def test_a_trip_stays_until_it_ended_and_was_acknowledged(pipeline, master):
    master.set("v", [24000, *[37000] * 95])
    low, _ = run(pipeline, master, 2)
    assert [a.ended_ns for a in low.alarms] == [None]
    master.set("v", [37000] * 96)
    snapshot, _ = run(pipeline, master, 4)
    ended = next(a for a in snapshot.alarms if a.code == "cell-undervoltage")
    assert not ended.active
    assert ended.ended_ns == low.t_wall_ns
    assert pipeline.acknowledge(ended.id, "anna")
    snapshot, _ = run(pipeline, master, 0.2)
    assert "cell-undervoltage" not in codes(snapshot) | codes(snapshot, active=False)
    assert not pipeline.acknowledge(9999, "anna")


def test_a_value_that_hovers_at_its_limit_does_not_flood(pipeline, master):
    events = []
    for i in range(200):
        master.set("v", [[24990, 25010][i // 5 % 2], *[37000] * 95])
        events += pipeline.feed(master.frame()).events
    assert len([e for e in events if e.code == "cell-undervoltage"]) <= 2


def test_hot_cells_are_watched_before_they_trip(pipeline, master):
    master.set("t", [42, *[25] * 95])
    snapshot, _ = run(pipeline, master, 4)
    assert "cell-overtemperature-near" in codes(snapshot)
    master.set("t", [47, *[25] * 95])
    snapshot, _ = run(pipeline, master, 4)
    assert "cell-overtemperature" in codes(snapshot)


def test_missing_cells_are_one_alarm_that_names_them_all(pipeline, master):
    master.set("v", [*[37000] * 50, 0, 0, *[37000] * 44])
    snapshot, _ = run(pipeline, master, 3)
    alarm = next(a for a in snapshot.alarms if a.code == "cell-voltage-missing")
    assert alarm.cell == 50
    assert alarm.cells == (50, 51)
    assert render(alarm.message, [12] * 8).startswith("2 ")


def test_a_silent_link_is_an_alarm(pipeline, master):
    run(pipeline, master, 1)
    start = master.t_ns
    for seconds in range(1, 6):
        snapshot = pipeline.tick(start + seconds * 1_000_000_000, start + seconds * 1_000_000_000).snapshot
    assert "rs232-silent" in codes(snapshot)


def test_all_well_raises_nothing(pipeline, master):
    snapshot, events = run(pipeline, master, 10)
    assert not [a for a in snapshot.alarms if a.severity != "watch"]
    assert not [e for e in events if e.severity in ("trip", "warning")]


def test_what_cannot_be_seen_any_more_has_not_ended(pipeline, master):
    master.set("t", [70, *[25] * 95])
    run(pipeline, master, 3)
    for seconds in range(1, 60):
        output = pipeline.tick(master.t_ns + seconds * 1_000_000_000, master.t_ns)
    assert output.snapshot.accumulator.temperature_max_degc is None
    assert "cell-overtemperature" in codes(output.snapshot)
    master.advance(60_000)
    master.set("t", [25] * 96)
    snapshot, events = run(pipeline, master, 5)
    assert "cell-overtemperature" not in codes(snapshot)
    assert any(render(e.message, [12] * 8).startswith("cleared") and e.code == "cell-overtemperature" for e in events)


def test_all_cells_gone_at_once_is_an_alarm(pipeline, master):
    run(pipeline, master, 1)
    master.set("v", [0] * 96)
    snapshot, _ = run(pipeline, master, 3)
    assert "cell-voltage-missing" in codes(snapshot)


@pytest.mark.parametrize("jump_s", [-86_400, 86_400])
def test_a_wall_clock_that_is_set_does_not_stretch_an_alarm(pipeline, master, jump_s):
    master.set("v", [24000, *[37000] * 95])
    run(pipeline, master, 2)
    master.set("v", [37000] * 96)
    texts = []
    for _ in range(40):
        item = master.frame()
        output = pipeline.feed(type(item)(item.t_mono_ns, item.t_wall_ns + jump_s * 10**9, item.frame))
        texts += [render(e.message, [12] * 8) for e in output.events if e.code == "cell-undervoltage"]
    assert len(texts) == 1
    seconds = float(texts[0].split()[2])
    assert 2 <= seconds <= 6
    assert "cell-undervoltage" in codes(output.snapshot, active=False)


SLAVES = (440, 1444)


def with_slaves(pipeline, master, statuses, n_slaves=8, seconds=2.0):
    master.set("n_slaves", [n_slaves])
    for pack, status in enumerate(statuses):
        master.set(f"slave[{pack}].status", [status])
    for part in range(0, SLAVES[1], 200):
        pipeline.feed(master.windows((SLAVES[0] + part, min(200, SLAVES[1] - part))))
    return run(pipeline, master, seconds)[0]


def test_every_slave_that_does_not_work_is_named(pipeline, master):
    snapshot = with_slaves(pipeline, master, [1, 1, 0, 1, 1, 1, 255, 1])
    (alarm,) = (each for each in snapshot.alarms if each.code == "slave-lost")
    assert (alarm.severity, alarm.message.args["packs"]) == ("warning", (Pack(2), Pack(6)))


def test_fewer_slaves_than_packs_are_an_alarm(pipeline, master):
    snapshot = with_slaves(pipeline, master, [1] * 8, n_slaves=7)
    assert "slaves-too-few" in codes(snapshot)
    assert codes(with_slaves(pipeline, master, [1] * 8, seconds=4)) == set()


@pytest.mark.parametrize(("field", "count"), [("i_fs", 2_100_000_000), ("i_fs", -2_100_000_000), ("soc", 65535)])
def test_what_cannot_be_is_missing_and_said(pipeline, master, field, count):
    run(pipeline, master, 1)
    before = run(pipeline, master, 1)[0].accumulator
    master.set(field, [count])
    snapshot = run(pipeline, master, 2)[0]
    (alarm,) = (each for each in snapshot.alarms if each.code == "value-implausible")
    assert alarm.message.args["fields"] == (field,)
    assert (snapshot.accumulator.current_a if field == "i_fs" else snapshot.master.soc) is None
    assert snapshot.accumulator.energy_out_wh - before.energy_out_wh < 5.0
    assert abs(snapshot.accumulator.soc - before.soc) < 0.01


def test_a_slave_that_is_not_heard_of_any_more_is_not_well_again(pipeline, master):
    with_slaves(pipeline, master, [1, 1, 0, 1, 1, 1, 1, 1])
    assert "slave-lost" in codes(run(pipeline, master, 20)[0])  # its part of the memory is blank by now


def test_the_cause_of_a_trip_stays_with_its_alarm_while_it_holds(pipeline, master):
    cause = TripCause("joint-resistance-high", condition("joint-resistance-high"), 40, 3, 0.9)
    pipeline.explain(cause)  # nothing tripped: there is nothing to explain
    master.set("v", [*[37000] * 40, 24000, *[37000] * 55])
    snapshot, _ = run(pipeline, master, 2)
    assert [alarm.cause for alarm in snapshot.alarms if alarm.severity == "trip"] == [None]
    pipeline.explain(cause)
    master.set("v", [*[37000] * 40, 23000, *[37000] * 55])
    snapshot, _ = run(pipeline, master, 2)
    assert [alarm.cause for alarm in snapshot.alarms if alarm.severity == "trip"] == [cause]
    assert [(each.code, each.cell) for each in snapshot.findings] == [("joint-resistance-high", 40)]


def test_what_tripped_stays_with_its_cell_once_the_trip_is_acknowledged_until_a_look_does_not_show_it(pipeline, master):
    cause = TripCause("joint-resistance-high", condition("joint-resistance-high"), 40, 3, 0.9, size=13e-3, unit="ohm")
    master.set("v", [*[37000] * 40, 24000, *[37000] * 55])
    tripped, _ = run(pipeline, master, 2)
    pipeline.explain(cause)
    for alarm in tripped.alarms:
        pipeline.acknowledge(alarm.id, "cora")
    master.set("v", [37000] * 96)
    snapshot, _ = run(pipeline, master, 6)
    assert {alarm.cause for alarm in snapshot.alarms if alarm.active} >= {cause}
    assert [(each.code, each.cell, each.size) for each in snapshot.findings] == [("joint-resistance-high", 40, 13e-3)]
    pipeline.name(())
    snapshot, _ = run(pipeline, master, 6)
    assert "joint-resistance-high" not in codes(snapshot)
    assert snapshot.findings == ()


@pytest.mark.parametrize("later_s", [8, 32])
def test_a_cause_that_is_revised_belongs_to_the_trips_of_its_incident_alone(pipeline, master, later_s):
    unknown = TripCause("unknown", condition("cause-unknown"), None, None, 0.0)
    revised = TripCause("joint-resistance-high", condition("joint-resistance-high"), 40, 3, 0.9, revised=True)
    master.set("v", [*[37000] * 40, 24000, *[37000] * 55])
    tripped, _ = run(pipeline, master, 2)
    at_ns = next(alarm.since_ns for alarm in tripped.alarms if alarm.severity == "trip")
    pipeline.explain(unknown, at_ns)
    master.set("v", [37000] * 96)
    run(pipeline, master, later_s - 2)  # it has ended, and stays listed
    master.set("t", [70, *[25] * 95])
    run(pipeline, master, 2)
    pipeline.explain(unknown, at_ns + later_s * 10**9)
    pipeline.explain(revised, at_ns)
    snapshot, _ = run(pipeline, master, 2)
    causes = {alarm.code: alarm.cause for alarm in snapshot.alarms if alarm.severity == "trip"}
    assert causes == {"cell-undervoltage": revised, "cell-overtemperature": unknown}


def test_what_the_recording_shows_is_an_alarm_until_a_look_does_not_show_it(pipeline, master):
    cause = TripCause("eeprom-worn", condition("eeprom-worn"), None, None, 0.9)
    pipeline.name((cause,))
    alarms = {alarm.code: alarm for alarm in run(pipeline, master, 3)[0].alarms}
    assert (alarms["eeprom-worn"].severity, alarms["eeprom-worn"].cause) == ("warning", cause)
    pipeline.name(())
    alarms = {alarm.code: alarm for alarm in run(pipeline, master, 5)[0].alarms}
    assert not alarms["eeprom-worn"].active


def test_an_alarm_by_the_recording_names_every_cell_of_its_kind_and_has_the_cause_of_now(pipeline, master):
    causes = [TripCause("cell-imbalance", condition("cell-imbalance"), cell, None, 0.9) for cell in (20, 50)]
    pipeline.name(tuple(causes))
    alarms = {alarm.code: alarm for alarm in run(pipeline, master, 3)[0].alarms}
    assert (alarms["cell-imbalance"].cells, alarms["cell-imbalance"].cause) == ((20, 50), causes[0])
    pipeline.name((causes[1],))
    alarms = {alarm.code: alarm for alarm in run(pipeline, master, 3)[0].alarms}
    assert (alarms["cell-imbalance"].cell, alarms["cell-imbalance"].cause) == (50, causes[1])


def test_no_restart_ends_an_alarm_by_the_recording_before_a_look_does(pipeline, master):
    cause = TripCause("eeprom-worn", condition("eeprom-worn"), None, None, 0.9)
    pipeline.name((cause,))
    snapshot, _ = run(pipeline, master, 3)
    tracker = AlarmTracker(snapshot.alarms)
    for k in range(5):
        alarms, _ = tracker.step(replace(snapshot, t_mono_ns=snapshot.t_mono_ns + k * 10**9))
        assert [alarm.active for alarm in alarms if alarm.code == "eeprom-worn"] == [True]
    tracker.name(())
    for k in range(5, 10):
        alarms, _ = tracker.step(replace(snapshot, t_mono_ns=snapshot.t_mono_ns + k * 10**9))
    assert [alarm.active for alarm in alarms if alarm.code == "eeprom-worn"] == [False]


def test_a_cell_has_the_condition_that_the_recording_shows(pipeline, master):
    """The watch from sample to sample and the judge of the recording are one on the page."""
    cause = TripCause("cell-resistance-high", condition("cell-resistance-high"), 40, 3, 0.9, size=2e-3, unit="ohm")
    pipeline.name((cause,))
    snapshot, _ = run(pipeline, master, 3)
    assert [(each.code, each.cell, each.size) for each in snapshot.findings] == [("cell-resistance-high", 40, 2e-3)]
    assert [alarm.code for alarm in snapshot.alarms if alarm.severity == "warning"] == ["cell-resistance-high"]


def test_a_master_that_restarts_is_told_with_the_reason_for_a_minute(pipeline, master):
    run(pipeline, master, 5)
    master.uptime_ms = 0
    boot = EventMessage(EventCode.BOOT, 0, 255, 1, 0)  # by its watchdog
    pipeline.feed(master.item(MessageType.EVENT, boot.to_body()))
    snapshot, _ = run(pipeline, master, 20)
    (told,) = [alarm for alarm in snapshot.alarms if alarm.code == "master-restarted"]
    assert told.severity == "warning"
    assert told.message.args["cause"] == Message("boot-watchdog")
    snapshot, _ = run(pipeline, master, 65)
    assert [alarm.active for alarm in snapshot.alarms if alarm.code == "master-restarted"] == [False]


def test_a_restart_shows_by_the_uptime_alone(pipeline, master):
    run(pipeline, master, 5)
    master.uptime_ms = 0
    snapshot, _ = run(pipeline, master, 20)
    (told,) = [alarm for alarm in snapshot.alarms if alarm.code == "master-restarted"]
    assert told.message.args["cause"] == Message("boot-cause-unknown")


def test_the_first_start_that_is_heard_is_no_restart(pipeline, master):
    boot = EventMessage(EventCode.BOOT, 0, 255, 0, 0)
    pipeline.feed(master.item(MessageType.EVENT, boot.to_body()))
    assert "master-restarted" not in codes(run(pipeline, master, 20)[0])


ALL_WELL = {"v": [37000] * 96, "t": [25] * 96, "i_fs": [1000], "soc": [8000], "status.flags": [0b100000001]}
TROUBLE = {
    "cell-undervoltage": {"v": [*[37000] * 40, 24000, *[37000] * 55]},
    "cell-overvoltage": {"v": [*[37000] * 40, 43000, *[37000] * 55]},
    "cell-overtemperature": {"t": [70, *[25] * 95]},
    "cell-undertemperature": {"t": [-40, *[25] * 95]},
    "discharge-overcurrent": {"i_fs": [60_000]},
    "charge-overcurrent": {"i_fs": [-60_000]},
    "cell-voltage-missing": {"v": [*[37000] * 50, 0, 0, *[37000] * 44]},
    "slave-lost": {"v": [*[37000] * 12, *[0] * 12, *[37000] * 72]},
    "value-implausible": {"i_fs": [2_100_000_000]},
    "master-fault": {"status.flags": [0]},
}


def tick_for(pipeline, master, seconds):
    """Nothing arrives: the last snapshot, and all events."""
    events, snapshot = [], None
    for _ in range(round(2 * seconds)):
        master.advance(500)
        output = pipeline.tick(master.t_ns, 1_700_000_000_000_000_000 + master.t_ns)
        events += output.events
        snapshot = output.snapshot
    return snapshot, events


@pytest.mark.parametrize("code", TROUBLE)
def test_silence_ends_no_alarm_and_a_measurement_does(pipeline, master, code):
    for name, counts in TROUBLE[code].items():
        master.set(name, counts)
    assert code in codes(run(pipeline, master, 4)[0])
    snapshot, events = tick_for(pipeline, master, 120)
    assert code in codes(snapshot)
    assert "alarm-ended" not in {event.message.code for event in events}
    for name, counts in ALL_WELL.items():
        master.set(name, counts)
    assert code not in codes(run(pipeline, master, 5)[0])


def test_a_restart_is_shown_until_the_master_is_there_again(pipeline, master):
    run(pipeline, master, 5)
    master.uptime_ms = 0
    run(pipeline, master, 5)
    assert "master-restarted" in codes(tick_for(pipeline, master, 120)[0])


@pytest.mark.parametrize(
    ("name", "code", "bad"), [("v", "cell-undervoltage", 24000), ("t", "cell-overtemperature", 70)]
)
def test_a_cell_that_is_not_measured_any_more_has_not_ended_its_alarm(pipeline, master, name, code, bad):
    good, missing = (37000, 0) if name == "v" else (25, -128)
    master.set(name, [*[good] * 40, bad, *[good] * 55])
    run(pipeline, master, 3)
    master.set(name, [*[good] * 40, missing, *[good] * 55])
    (alarm,) = (each for each in run(pipeline, master, 20)[0].alarms if each.code == code)
    assert (alarm.active, alarm.cell) == (True, 40)
    master.set(name, [good] * 96)
    assert code not in codes(run(pipeline, master, 5)[0])


@pytest.mark.parametrize("state", ["connecting", "open"])
def test_a_port_that_is_tried_again_has_not_ended_its_alarm(pipeline, master, state):
    pipeline.feed(LinkChange(master.t_ns, 0, "rs232", "lost"))
    assert "rs232-lost" in codes(tick_for(pipeline, master, 3)[0])
    pipeline.feed(LinkChange(master.t_ns, 0, "rs232", state))
    assert {"rs232-lost", "rs232-silent"} & codes(tick_for(pipeline, master, 20)[0])


def test_a_lost_slave_is_its_pack_and_no_cells_without_a_voltage(pipeline, master):
    master.set("v", [*[37000] * 36, *[0] * 12, *[37000] * 48])
    master.set("t", [*[25] * 36, *[-128] * 12, *[25] * 48])
    snapshot, events = run(pipeline, master, 10)
    (alarm,) = (each for each in snapshot.alarms if each.active)
    assert (alarm.code, alarm.cell, alarm.message.args["packs"]) == ("slave-lost", None, (Pack(3),))
    assert render(alarm.message, [12] * 8) == "slave board of pack 4 lost"
    assert {event.cell for event in events} == {None}


def test_a_trip_by_a_lost_slave_names_its_pack_and_no_cell(pipeline, master):
    event = pipeline.feed(
        master.item(MessageType.EVENT, EventMessage(EventCode.TRIP_SLAVE_LOST, 0, 36, 0, 0).to_body())
    )
    assert [(each.code, each.cell, render(each.message, [12] * 8)) for each in event.events] == [
        ("trip-slave-lost", None, "slave board of pack 4 lost")
    ]
    master.set("status.flags", [0])
    (alarm,) = (each for each in run(pipeline, master, 1)[0].alarms if each.code == "master-fault")
    assert render(alarm.message, [12] * 8) == "shutdown circuit open: slave board of pack 4 lost"
    assert (alarm.cell, alarm.cells) == (None, tuple(range(36, 48)))
