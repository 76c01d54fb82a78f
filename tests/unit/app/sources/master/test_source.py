from dataclasses import asdict, fields, replace

import numpy as np
import pytest

from app.sources.items import CanFault, CanItem, LinkChange
from app.sources.master.source import MasterSource
from app.telemetry import Flags
from firmware_protocol.memory_map import CONFIG, STATUS_FLAGS
from firmware_protocol.messages import EventCode, EventMessage, Ident, MessageType, Reply

LIMITS = {  # of the configuration: counts, and what they are in the measurement
    "v_cell_min": (25_100, "cell_voltage_min_v", 2.51),
    "v_cell_max": (41_900, "cell_voltage_max_v", 4.19),
    "t_cell_min": (-5, "temperature_min_degc", -5.0),
    "t_cell_max": (55, "temperature_max_degc", 55.0),
    "i_disc_max": (20_000, "discharge_max_a", 200.0),
    "i_disc_min": (-5_000, "discharge_min_a", -50.0),
    "i_chrg_max": (1_000, "charger_max_a", 10.0),
    "i_chrg_min": (100, "charger_min_a", 1.0),
}


@pytest.fixture
def source():
    made = MasterSource("serial", "/dev/x", "virtual:x")
    for link in ("rs232", "can"):
        made.feed(LinkChange(0, 0, link, "open"))
    return made


def test_a_frame_with_voltages_is_a_sample(source, master):
    measured = source.feed(master.frame()).measurement
    assert (measured.is_sample, measured.is_fresh) == (True, True)
    assert measured.current_a == pytest.approx(10.0)
    assert measured.voltage_v[3] == pytest.approx(3.7003)
    assert (measured.t_mono_ns, measured.uptime_ms) == (master.t_ns, master.uptime_ms)


def test_a_frame_without_voltages_is_no_measurement_yet(source, master):
    assert source.feed(master.config()).measurement is None


def test_time_steps_are_those_of_the_masters_clock(source, master):
    assert source.feed(master.frame()).measurement.dt_s is None
    master.t_ns += 5_000_000_000  # late on the line
    assert source.feed(master.frame(250)).measurement.dt_s == pytest.approx(0.25)
    master.uptime_ms = 5
    assert source.feed(master.frame(0)).measurement.dt_s is None, "a reset"


def test_can_alone_measures_without_a_sample(source):
    data = bytes([0x10, 0x27, 0xC0, 0x8A]) + (-250).to_bytes(4, "little", signed=True)
    measured = source.feed(CanItem(5_000_000_000, 5, 0x100, data)).measurement
    assert (measured.is_sample, measured.is_fresh, measured.dt_s) == (False, True, None)
    assert measured.current_a == pytest.approx(-2.5)
    assert np.isnan(measured.voltage_v).all()


def test_without_anything_new_only_the_ages_grow(source, master):
    source.feed(master.frame())
    measured = source.measure(master.t_ns + 2_000_000_000, 1)
    assert (measured.is_sample, measured.is_fresh) == (False, False)
    assert measured.age_s.current == pytest.approx(2.0)


def test_limits_are_those_of_the_configuration_once_all_of_it_came(source, master):
    for name, (raw, _, _) in LIMITS.items():
        CONFIG[name].pack_into(master.image, (raw,))
    assert source.feed(master.frame()).measurement.limits is None
    source.feed(master.config())
    limits = source.feed(master.frame()).measurement.limits
    told = {name: value for name, value in asdict(limits).items() if not np.isnan(value)}
    assert told == {name: pytest.approx(value) for _, name, value in LIMITS.values()} | {"in_any_state": False}


def test_the_chips_readings_are_missing_until_they_came_and_when_they_are_old(source, master):
    master.set("slave[2].cvr", [36_000, 0, *[37_000] * 10])
    source.feed(master.frame())
    assert np.isnan(source.measure(master.t_ns, 1).chip_voltage_v).all()
    start = 440 + 2 * 180
    for part in (start - 100, start + 100):
        source.feed(master.windows((part, 300)))
    chips_v = source.measure(master.t_ns, 1).chip_voltage_v
    assert chips_v[24:27] == pytest.approx([3.6, np.nan, 3.7], nan_ok=True)
    assert np.isnan(source.measure(master.t_ns + 11_000_000_000, 1).chip_voltage_v).all()


def test_the_masters_extremes_need_a_cell_that_there_is(source, master):
    master.set("v_min", [36_000])
    master.set("v_min_id", [200])
    master.set("v_max", [0])
    reported = source.feed(master.frame()).measurement.reported
    assert reported.voltage_min_v == (pytest.approx(3.6), None)
    assert reported.voltage_max_v == (None, None)


def test_the_master_introduces_itself_and_says_why_it_tripped(source, master):
    identity = Reply(MessageType.IDENT, 4, 0, data=Ident((1, 2, 3), boots=7).to_bytes())
    source.feed(master.item(MessageType.REPLY, identity.to_body()))
    assert (source.identity.firmware, source.identity.boots) == ("1.2.3", 7)
    trip = EventMessage(EventCode.TRIP_V_MAX, 0, 31, 42100, 42000)
    (event,) = source.feed(master.item(MessageType.EVENT, trip.to_body())).events
    assert (event.severity, event.cell) == ("trip", 31)
    master.set("status.flags", [0])
    said = source.feed(master.frame()).measurement.master
    assert (said.state, said.firmware) == ("fault", "1.2.3")


def test_an_identity_that_nobody_asked_for_is_rejected_and_noted_once(source, master):
    def introduce(version, asked):
        reply = Reply(MessageType.IDENT, 4, 0, data=Ident(version).to_bytes())
        item = replace(master.item(MessageType.REPLY, reply.to_body()), is_asked=asked)
        return [event.code for event in source.feed(item).events]

    assert introduce((1, 2, 3), asked=True) == []
    assert introduce((6, 6, 6), asked=False) == ["ident-unasked"]
    assert introduce((6, 6, 6), asked=False) == []
    assert introduce((1, 2, 3), asked=False) == [], "an answer that came twice says nothing new"
    assert source.identity.firmware == "1.2.3"


@pytest.mark.parametrize(
    ("kind", "body"),
    [
        (MessageType.DATA, b"\xff\xff\x10\x00" + bytes(16)),
        (MessageType.EVENT, b"\x01"),
        (MessageType.REPLY, b""),
        (MessageType.REPLY, Reply(MessageType.IDENT, 1, 0, data=b"\x01").to_body()),
    ],
    ids=["windows outside", "a short event", "an empty reply", "an introduction of one byte"],
)
def test_a_right_checksum_with_an_impossible_body_is_no_good_frame(source, master, kind, body):
    before = source.measure(master.t_ns, 1).links.rs232
    told = [event.code for _ in range(3) for event in source.feed(master.item(kind, body)).events]
    after = source.measure(master.t_ns, 1).links.rs232
    assert told == ["frames-malformed"]
    assert (after.frames - before.frames, after.resyncs - before.resyncs) == (0, 3)
    assert after.crc_errors == before.crc_errors
    assert source.identity is None


def test_the_flags_are_the_memory_maps_in_their_order():
    assert tuple(field.name for field in fields(Flags)) == STATUS_FLAGS


def test_a_reason_ends_with_the_fault_that_it_was_of(source, master):
    source.feed(master.item(MessageType.EVENT, EventMessage(EventCode.TRIP_V_MAX, 0, 31, 42100, 42000).to_body()))
    source.feed(master.item(MessageType.EVENT, EventMessage(EventCode.FAULTS_CLEARED, 0, 255, 0, 0).to_body()))
    master.set("status.flags", [0])
    measured = source.feed(master.frame()).measurement
    assert (measured.master.state, measured.master.why.code) == ("fault", "shutdown-circuit-open")


def test_error_frames_on_can_are_told_every_few_seconds():
    source = MasterSource("serial", None, "virtual:x")
    told = []
    for k in range(120):  # one every 0.1 s
        at_ns = 10**10 + k * 10**8
        told += source.feed(CanFault(at_ns, at_ns, "active", k + 1)).events
    assert [event.code for event in told if event.code == "can-error-frames"] == ["can-error-frames"] * 2
    assert all(event.severity == "watch" for event in told)


def test_a_single_error_frame_on_can_is_not_told():
    source = MasterSource("serial", None, "virtual:x")
    faults = [CanFault(10**10 + k * 6 * 10**9, 0, "active", k + 1) for k in range(5)]
    assert [event for fault in faults for event in source.feed(fault).events] == []
