"""A master behind two links: what each may change, whose word counts, and what is never mixed."""

import pytest

from app.sources.items import CanFault, CanItem, LinkChange, SerialItem
from app.sources.master.source import MasterSource
from app.words import render
from firmware_protocol.framing import BadFrame, BadReason
from firmware_protocol.memory_map import CONFIG
from firmware_protocol.messages import EventCode, EventMessage, Ident, MessageType, Reply

SECOND = 1_000_000_000
SUMMARY = 0x100  # soc, v_tot and i_fs in the default tables


def summary(current_a, soc=0.5, total_v=360.0):
    return b"".join(
        round(value * scale).to_bytes(size, "little", signed=size == 4)
        for value, scale, size in ((soc, 10_000, 2), (total_v, 100, 2), (current_a, 100, 4))
    )


@pytest.fixture
def source():
    made = MasterSource("serial", "/dev/x", "virtual:x")
    for link in ("rs232", "can"):
        made.feed(LinkChange(0, 0, link, "open"))
    return made


def on_can(source, t_s, current_a, **said):
    return source.feed(CanItem(round(t_s * SECOND), 1, SUMMARY, summary(current_a), **said))


def test_while_rs232_is_live_can_changes_nothing(source, master):
    source.feed(master.frame())
    assert on_can(source, master.t_ns / SECOND + 0.5, 99.0).measurement is None
    assert source.measure(master.t_ns, 1).current_a == pytest.approx(10.0)


def test_can_takes_over_a_second_after_rs232_fell_silent(source, master):
    source.feed(master.frame())
    later_s = master.t_ns / SECOND + 1.0
    assert on_can(source, later_s, -5.0).measurement.current_a == pytest.approx(-5.0)


def test_can_measures_twenty_times_a_second_at_most(source):
    measured = [on_can(source, 10 + i / 100, 1.0).measurement is not None for i in range(100)]
    assert sum(measured) == 20


def test_what_we_sent_ourselves_tells_nothing(source):
    assert on_can(source, 10, 50.0, sent=True).measurement is None
    assert source.measure(10 * SECOND, 1).current_a is None


def test_a_message_that_no_table_has_tells_nothing(source):
    assert source.feed(CanItem(10 * SECOND, 1, 0x555, bytes(8))).measurement is None
    assert source.measure(10 * SECOND, 1).links.can.frames == 1, "but it was heard"


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


@pytest.mark.parametrize("body", [b"", b"\x5c\x07\x04\x00\x00", b"\xff\xff\x01\x00\x00"])
def test_a_frame_whose_body_means_nothing_changes_nothing(source, master, body):
    source.feed(master.frame())
    assert source.feed(master.item(MessageType.DATA, body)).measurement is None
    assert source.measure(master.t_ns, 1).current_a == pytest.approx(10.0)


@pytest.mark.parametrize(("map_hash", "matches"), [(None, True), (bytes(8), False)])
def test_a_master_of_another_map_is_known_as_such(source, master, map_hash, matches):
    ident = Ident((2, 0, 1)) if map_hash is None else Ident((2, 0, 1), map_hash=map_hash)
    source.feed(master.item(MessageType.REPLY, Reply(MessageType.IDENT, 1, 0, data=ident.to_bytes()).to_body()))
    said = source.feed(master.frame()).measurement.master
    assert (said.firmware, said.protocol, said.map_matches) == ("2.0.1", 1, matches)


def test_a_link_that_opens_or_is_lost_is_told_once():
    source = MasterSource("serial", "/dev/x", None)
    told = [
        [event.severity for event in source.feed(LinkChange(i, 5, "rs232", state, error)).events]
        for i, (state, error) in enumerate(
            (("connecting", None), ("lost", "no such port"), ("lost", "no such port"), ("open", None), ("lost", "gone"))
        )
    ]
    assert told == [[], ["watch"], [], ["info"], ["watch"]]


def test_a_bus_that_goes_passive_is_told_with_its_errors(source):
    def fault(state, errors):
        return source.feed(CanFault(1, 7, state, errors)).events

    assert fault("active", 0) == ()
    [passive] = fault("passive", 12)
    assert (passive.severity, passive.code, passive.time_ns) == ("warning", "can-passive", 7)
    assert "12" in render(passive.message)
    assert fault("passive", 13) == ()
    [off] = fault("off", None)
    assert (off.severity, off.code) == ("warning", "can-off")
    [well] = fault("active", 13)
    assert well.severity == "info"


def test_a_can_controller_does_not_tell_its_bad_frames(source):
    links = source.measure(1, 1).links
    assert (links.can.crc_errors, links.can.resyncs) == (None, None)
    assert (links.rs232.crc_errors, links.rs232.resyncs) == (0, 0)


@pytest.mark.parametrize(("step_ms", "dt_s"), [(0, 0.0), (3_600_000, 3600.0), (3_600_001, None)])
def test_a_step_longer_than_an_hour_is_none(source, master, step_ms, dt_s):
    source.feed(master.frame())
    assert source.feed(master.frame(step_ms)).measurement.dt_s == dt_s


def test_the_masters_clock_goes_round_without_a_hole(source, master):
    master.uptime_ms = (1 << 32) - 40
    source.feed(master.frame(0))
    master.uptime_ms = 60
    assert source.feed(master.frame(0)).measurement.dt_s == pytest.approx(0.1)
