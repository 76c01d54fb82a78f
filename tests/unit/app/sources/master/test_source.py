"""A master behind two links: what each may change, whose word counts, and what is never mixed."""

from dataclasses import asdict, fields, replace

import numpy as np
import pytest

from app.sources.items import CanFault, CanItem, LinkChange, SerialItem
from app.sources.master.source import MasterSource
from app.telemetry import Flags
from app.words import render
from firmware_protocol.framing import BadFrame, BadReason
from firmware_protocol.memory_map import CONFIG, STATUS_FLAGS
from firmware_protocol.messages import EventCode, EventMessage, Ident, MessageType, Reply

SECOND = 1_000_000_000
SUMMARY = 0x100  # soc, v_tot and i_fs in the default tables
LIMITS = {  # limits of the configuration: counts, and their values in the measurement
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


def summary(current_a, soc=0.5, total_v=360.0):
    return b"".join(
        round(value * scale).to_bytes(size, "little", signed=size == 4)
        for value, scale, size in ((soc, 10_000, 2), (total_v, 100, 2), (current_a, 100, 4))
    )


def on_can(source, t_s, current_a, **said):
    return source.feed(CanItem(round(t_s * SECOND), 1, SUMMARY, summary(current_a), **said))


def test_a_frame_with_voltages_is_a_sample(source, master):
    assert source.feed(master.config()).measurement is None, "without voltages it is none yet"
    measured = source.feed(master.frame()).measurement
    assert (measured.is_sample, measured.is_fresh) == (True, True)
    assert measured.current_a == pytest.approx(10.0)
    assert measured.voltage_v[3] == pytest.approx(3.7003)
    assert (measured.t_mono_ns, measured.uptime_ms) == (master.t_ns, master.uptime_ms)


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


def test_the_master_says_why_it_tripped_until_its_faults_are_cleared(source, master):
    trip = EventMessage(EventCode.TRIP_V_MAX, 0, 31, 42100, 42000)
    (event,) = source.feed(master.item(MessageType.EVENT, trip.to_body())).events
    assert (event.severity, event.cell) == ("trip", 31)
    master.set("status.flags", [0])
    said = source.feed(master.frame()).measurement.master
    assert (said.state, said.why.code) == ("fault", "trip-cell")
    source.feed(master.item(MessageType.EVENT, EventMessage(EventCode.FAULTS_CLEARED, 0, 255, 0, 0).to_body()))
    assert source.feed(master.frame()).measurement.master.why.code == "shutdown-circuit-open"


@pytest.mark.parametrize(("map_hash", "matches"), [(None, True), (bytes(8), False)])
def test_the_master_introduces_itself_and_another_map_is_known_as_such(source, master, map_hash, matches):
    ident = Ident((2, 0, 1), boots=7) if map_hash is None else Ident((2, 0, 1), boots=7, map_hash=map_hash)
    source.feed(master.item(MessageType.REPLY, Reply(MessageType.IDENT, 4, 0, data=ident.to_bytes()).to_body()))
    assert (source.identity.firmware, source.identity.boots) == ("2.0.1", 7)
    said = source.feed(master.frame()).measurement.master
    assert (said.firmware, said.protocol, said.map_matches) == ("2.0.1", 1, matches)


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
        (MessageType.DATA, b"\x5c\x07\x04\x00\x00"),
        (MessageType.EVENT, b"\x01"),
        (MessageType.REPLY, b""),
        (MessageType.REPLY, Reply(MessageType.IDENT, 1, 0, data=b"\x01").to_body()),
    ],
    ids=[
        "windows outside",
        "half a window",
        "a short event",
        "an empty reply",
        "an introduction of one byte",
    ],
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


def test_while_rs232_is_live_can_changes_nothing(source, master):
    source.feed(master.frame())
    assert on_can(source, master.t_ns / SECOND + 0.5, 99.0).measurement is None
    assert source.measure(master.t_ns, 1).current_a == pytest.approx(10.0)


def test_can_takes_over_a_second_after_rs232_fell_silent_and_measures_without_a_sample(source, master):
    source.feed(master.frame())
    measured = on_can(source, master.t_ns / SECOND + 1.0, -5.0).measurement
    assert measured.current_a == pytest.approx(-5.0)
    assert (measured.is_sample, measured.is_fresh, measured.dt_s) == (False, True, None)


def test_can_measures_twenty_times_a_second_at_most(source):
    measured = [on_can(source, 10 + i / 100, 1.0).measurement is not None for i in range(100)]
    assert sum(measured) == 20


def test_what_we_sent_ourselves_and_a_message_that_no_table_has_tell_nothing(source):
    assert on_can(source, 10, 50.0, sent=True).measurement is None
    assert source.feed(CanItem(10 * SECOND, 1, 0x555, bytes(8))).measurement is None
    found = source.measure(10 * SECOND, 1)
    assert found.current_a is None
    assert np.isnan(found.voltage_v).all()
    assert found.links.can.frames == 2, "but they were on the bus"


def test_the_tables_of_the_configuration_in_force_are_used(source, master):
    ids = list(CONFIG["can_tx_msg_id"].unpack(master.image))
    ids[1] = 0x3AB
    CONFIG["can_tx_msg_id"].pack_into(master.image, tuple(ids))
    source.feed(master.config())
    source.feed(master.frame())
    late_s = master.t_ns / SECOND + 5
    assert on_can(source, late_s, 7.0).measurement is None, "the default's id"
    moved = source.feed(CanItem(round((late_s + 1) * SECOND), 1, 0x3AB, summary(7.0))).measurement
    assert moved.current_a == pytest.approx(7.0)


def test_the_pieces_of_two_configurations_are_never_one(source, master):
    source.feed(master.config())
    before = source.feed(master.frame()).measurement
    assert before.config == bytes(master.image[:420])
    assert before.config_hash is not None
    master.t_ns += SECOND
    source.feed(master.item(MessageType.EVENT, EventMessage(EventCode.CONFIG_WRITTEN, 0, 0xFFFF, 0, 0).to_body()))
    CONFIG["telemetry_period"].pack_into(master.image, (50,))
    master.t_ns += SECOND
    source.feed(master.windows((0, 200)))
    half = source.feed(master.frame()).measurement
    assert (half.config, half.config_hash) == (before.config, before.config_hash)
    source.feed(master.windows((200, 220)))
    whole = source.feed(master.frame()).measurement
    assert whole.config == bytes(master.image[:420])
    assert whole.config_hash != before.config_hash


@pytest.mark.parametrize("reason", list(BadReason))
def test_a_bad_frame_is_counted_and_changes_nothing(source, master, reason):
    before = source.feed(master.frame()).measurement
    received = source.feed(SerialItem(master.t_ns + 1, 1, BadFrame(reason, b"\x01\x02")))
    assert (received.measurement, received.events) == (None, ())
    after = source.measure(master.t_ns + 1, 1)
    assert after.current_a == before.current_a
    assert after.links.rs232.crc_errors + after.links.rs232.resyncs == 1


def test_a_link_that_opens_or_is_lost_is_told_once_for_each_reason():
    source = MasterSource("serial", "/dev/x", None)

    def severities(state, error=None):
        return [event.severity for event in source.feed(LinkChange(0, 5, "rs232", state, error)).events]

    told = [severities("connecting"), *(severities("lost", "no such port") for _ in range(3))]
    assert told == [[], ["watch"], [], []]
    assert severities("lost", "permission denied") == ["watch"]
    assert severities("open") == ["info"]
    assert severities("lost", "permission denied") == ["watch"]


def test_a_bus_that_goes_passive_is_told_with_its_errors(source):
    def fault(state, errors):
        return source.feed(CanFault(1, 7, state, errors)).events

    assert fault("active", 0) == ()
    [passive] = fault("passive", 12)
    assert (passive.severity, passive.code, passive.time_ns) == ("warning", "can-passive", 7)
    assert "12" in render(passive.message)
    assert fault("passive", 13) == fault(None, 13) == (), "an unknown state is no news"
    [off] = fault("off", None)
    assert (off.severity, off.code) == ("warning", "can-off")
    [well] = fault("active", 13)
    assert well.severity == "info"


@pytest.mark.parametrize(
    ("from_ms", "to_ms", "dt_s"),
    [
        (0, 0, 0.0),
        (0, 250, 0.25),
        (0, 3_600_000, 3600.0),
        (0, 3_600_001, None),
        ((1 << 32) - 40, 60, 0.1),  # its clock goes round
        (1000, 5, None),  # a reset
    ],
)
def test_time_steps_are_those_of_the_masters_clock_up_to_an_hour(source, master, from_ms, to_ms, dt_s):
    master.uptime_ms = from_ms
    assert source.feed(master.frame(0)).measurement.dt_s is None
    master.t_ns += 5 * SECOND  # late on the line
    master.uptime_ms = to_ms
    assert source.feed(master.frame(0)).measurement.dt_s == (None if dt_s is None else pytest.approx(dt_s))


@pytest.mark.parametrize(("n", "apart_s", "told"), [(120, 0.1, 2), (5, 6.0, 0)])
def test_error_frames_on_can_are_told_every_few_seconds_and_single_ones_not(n, apart_s, told):
    source = MasterSource("serial", None, "virtual:x")
    faults = [CanFault(10**10 + round(k * apart_s * SECOND), 0, "active", k + 1) for k in range(n)]
    events = [event for fault in faults for event in source.feed(fault).events]
    assert [(event.code, event.severity) for event in events if event.code == "can-error-frames"] == [
        ("can-error-frames", "watch")
    ] * told


def boot(master, cause):
    """The event of a boot; the master's clock begins at 0."""
    master.uptime_ms = 0
    return master.item(MessageType.EVENT, EventMessage(EventCode.BOOT, 0, 255, cause, 0).to_body())


@pytest.mark.parametrize(("cause", "was_off"), [(0, True), (1, False), (2, False), (3, False), (9, True), (None, True)])
def test_a_master_may_have_been_without_power_unless_its_boot_says_otherwise(source, master, cause, was_off):
    assert not source.feed(master.frame()).measurement.was_off, "the first measurement has none before it"
    if cause is None:
        master.uptime_ms = 0
    else:
        source.feed(boot(master, cause))
    found = [source.feed(master.frame()).measurement.was_off for _ in range(3)]
    assert found == [was_off, False, False]


def test_a_count_that_has_not_begun_is_missing_and_not_empty(source, master):
    master.set("soc", [0])
    master.set("dod", [0])
    found = source.feed(master.frame()).measurement.master
    assert (found.soc, found.charge_drawn_ah) == (None, None)
    master.set("dod", [25_000_000])
    assert source.feed(master.frame()).measurement.master.soc == 0.0
