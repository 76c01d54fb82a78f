from dataclasses import asdict

import numpy as np
import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.estimation.errors import EstimatorError
from app.estimation.filters.estimators import make_estimator
from app.live.pipeline import Pipeline
from app.sources.items import CanItem, LinkChange
from app.sources.master.source import MasterSource
from app.words import render
from firmware_protocol.framing import decode_chunk
from firmware_protocol.memory_map import FIELDS
from firmware_protocol.messages import EventCode, EventMessage, Ident, MessageType, Reply

CELL = load_cell("samsung-25r-10p")


@pytest.fixture
def pipeline():
    chain = Pipeline(
        MasterSource("serial", "/dev/x", "virtual:x"),
        lambda: make_estimator("fused", CELL, 96),
        filter_name="fused",
        cell_name="samsung-25r-10p",
    )
    for link in ("rs232", "can"):
        chain.feed(LinkChange(0, 0, link, "open"))
    return chain


def test_a_frame_becomes_a_snapshot_in_units(pipeline, master):
    snapshot = pipeline.feed(master.frame()).snapshot
    assert snapshot.cells.voltage_v[3] == pytest.approx(3.7003)
    assert snapshot.cells.temperature_degc[0] == 25
    total = snapshot.accumulator
    assert total.current_a == pytest.approx(10.0)
    assert total.power_w == pytest.approx(3552.0)
    assert (total.voltage_min_cell, total.voltage_max_cell) == (0, 95)
    assert snapshot.master.state == "drive"
    assert snapshot.links.rs232.state == "live"


def test_nothing_known_is_missing_and_not_zero(pipeline):
    snapshot = pipeline.tick(1_000_000_000, 1).snapshot
    assert np.isnan(snapshot.cells.voltage_v).all()
    assert np.isnan(snapshot.cells.soc).all()
    known = {"loaded_cells": 0, "energy_out_wh": 0.0, "energy_in_wh": 0.0}
    assert {name: value for name, value in asdict(snapshot.accumulator).items() if value is not None} == known
    assert snapshot.master.state == "unknown"
    assert set(asdict(snapshot.age_s).values()) == {None}
    assert snapshot.alarms == ()


def test_a_cell_that_reads_zero_is_missing_and_not_the_lowest(pipeline, master):
    master.set("v", [0, *[37000] * 95])
    snapshot = pipeline.feed(master.frame()).snapshot
    assert np.isnan(snapshot.cells.voltage_v[0])
    assert snapshot.accumulator.voltage_min_cell == 1
    assert snapshot.accumulator.loaded_cells == 95
    assert snapshot.packs[0].voltage_v is None
    assert snapshot.packs[1].voltage_v == pytest.approx(12 * 3.7)


def test_values_older_than_ten_seconds_are_gone(pipeline, master):
    pipeline.feed(master.frame())
    recent = pipeline.tick(master.t_ns + 9_000_000_000, 1).snapshot
    old = pipeline.tick(master.t_ns + 11_000_000_000, 1).snapshot
    assert recent.accumulator.current_a is not None
    assert recent.age_s.current == pytest.approx(9.0)
    assert old.accumulator.current_a is None
    assert np.isnan(old.cells.voltage_v).all()
    assert np.isnan(old.cells.soc).all()
    assert old.master.state == "unknown"
    assert old.age_s.current == pytest.approx(11.0)


def test_charge_follows_the_masters_clock_and_not_arrival(pipeline, master):
    master.set("i_fs", [10000])
    pipeline.feed(master.frame())
    before = pipeline.feed(master.frame()).snapshot.accumulator.energy_out_wh
    master.uptime_ms += 3_600
    after = pipeline.feed(master.frame(0)).snapshot.accumulator.energy_out_wh
    assert after - before == pytest.approx(float(np.sum([3.7 + i * 1e-4 for i in range(96)])) * 100 * 3.6 / 3600)


def test_a_master_reset_takes_no_charge(pipeline, master):
    master.set("i_fs", [10000])
    pipeline.feed(master.frame())
    before = pipeline.feed(master.frame()).snapshot.accumulator.energy_out_wh
    master.uptime_ms = 5
    after = pipeline.feed(master.frame(0)).snapshot
    assert after.accumulator.energy_out_wh == before
    assert not np.isnan(after.cells.soc).any()


def test_uptime_wraps_after_49_days(pipeline, master):
    master.set("i_fs", [10000])
    master.uptime_ms = (1 << 32) - 150
    pipeline.feed(master.frame())
    before = pipeline.feed(master.frame(0)).snapshot.accumulator.energy_out_wh
    master.uptime_ms = 50
    after = pipeline.feed(master.frame(0)).snapshot.accumulator.energy_out_wh
    assert after > before


def test_can_alone_fills_what_its_message_carries(pipeline, master):
    data = bytes([0x10, 0x27, 0xC0, 0x8A]) + (-250).to_bytes(4, "little", signed=True)
    snapshot = pipeline.feed(CanItem(5_000_000_000, 5, 0x100, data)).snapshot
    assert snapshot.accumulator.soc == pytest.approx(1.0)
    assert snapshot.accumulator.soc_source == "master"
    assert snapshot.accumulator.voltage_v == pytest.approx(355.2)
    assert snapshot.accumulator.current_a == pytest.approx(-2.5)
    assert np.isnan(snapshot.cells.voltage_v).all()
    assert snapshot.age_s.voltage is None
    assert snapshot.links.can.state == "live"


def test_can_does_not_disturb_a_live_rs232(pipeline, master):
    pipeline.feed(master.frame())
    output = pipeline.feed(CanItem(master.t_ns, 5, 0x100, bytes(8)))
    assert output.snapshot is None
    assert pipeline.tick(master.t_ns + 1, 1).snapshot.accumulator.current_a == pytest.approx(10.0)


def test_a_bad_frame_changes_no_field(pipeline, master):
    before = pipeline.feed(master.frame()).snapshot
    good = master.frame().frame.raw
    bad = bytes([*good[:-1], good[-1] ^ 1])
    item = master.frame()
    output = pipeline.feed(type(item)(item.t_mono_ns, item.t_wall_ns, decode_chunk(bad)))
    assert output.snapshot is None
    after = pipeline.tick(item.t_mono_ns, 1).snapshot
    assert (after.cells.voltage_v == before.cells.voltage_v).all()
    assert after.accumulator == before.accumulator
    assert after.links.rs232.crc_errors + after.links.rs232.resyncs == 1


def test_the_master_introduces_itself(pipeline, master):
    ident = Ident((1, 2, 3), boots=7)
    body = Reply(MessageType.IDENT, 4, 0, data=ident.to_bytes()).to_body()
    pipeline.feed(master.item(MessageType.REPLY, body))
    master_part = pipeline.feed(master.frame()).snapshot.master
    assert (master_part.firmware, master_part.boots, master_part.map_matches) == ("1.2.3", 7, True)


def test_a_trip_names_cell_value_and_limit(pipeline, master):
    body = EventMessage(EventCode.TRIP_V_MAX, 0, 31, 42100, 42000).to_body()
    event = pipeline.feed(master.item(MessageType.EVENT, body)).events[0]
    assert (event.severity, event.cell) == ("trip", 31)
    assert event.value == pytest.approx(4.21)
    assert "pack 3, cell 8" in render(event.message, [12] * 8)
    master.set("status.flags", [0])
    snapshot = pipeline.feed(master.frame()).snapshot
    assert snapshot.master.state == "fault"
    assert "4.21" in render(snapshot.master.why)


def test_the_configuration_in_force_has_a_hash_once_it_was_heard(pipeline, master):
    assert pipeline.feed(master.frame()).snapshot.config_hash is None
    pipeline.feed(master.config())
    first = pipeline.feed(master.frame()).snapshot.config_hash
    master.set("conf.ts", [50])
    pipeline.feed(master.config())
    assert pipeline.feed(master.frame()).snapshot.config_hash not in (None, first)


def test_the_same_items_give_the_same_snapshots(master):
    items = [master.config(), *[master.frame() for _ in range(20)]]

    def run():
        chain = Pipeline(
            MasterSource("replay"), lambda: make_estimator("fused", CELL, 96), filter_name="f", cell_name="c"
        )
        outputs = [chain.feed(item).snapshot for item in items]
        return [(s.cells.voltage_v.tobytes(), s.cells.soc.tobytes(), s.accumulator) for s in outputs if s]

    assert run() == run()


def test_a_missing_port_is_one_event_however_often_it_is_tried(pipeline):
    lost = LinkChange(1, 1, "rs232", "lost", "port not found (unplugged?)")
    assert [len(pipeline.feed(lost).events) for _ in range(5)] == [1, 0, 0, 0, 0]


def test_a_configuration_is_never_the_pieces_of_two(pipeline, master):
    for piece in ((0, 200), (200, 220)):
        pipeline.feed(master.windows(piece))
    old = pipeline.feed(master.frame()).snapshot
    master.set("conf.ts", [50])
    master.set("conf.can_tx_msg_id", [0x123] * 8)
    master.advance()
    pipeline.feed(master.item(MessageType.EVENT, EventMessage(EventCode.CONFIG_WRITTEN, 0, 0xFFFF, 0, 420).to_body()))
    pipeline.feed(master.windows((0, 200)))
    between = pipeline.feed(master.frame()).snapshot
    assert (between.config_hash, between.config) == (old.config_hash, old.config)
    pipeline.feed(master.windows((200, 220)))
    new = pipeline.feed(master.frame()).snapshot
    assert new.config == bytes(master.image[:420])
    assert new.config_hash != old.config_hash


def test_no_cell_measured_is_no_zero_volts(pipeline, master):
    master.set("v", [0] * 96)
    for name in ("v_tot", "v_min", "v_max"):
        master.set(name, [0])
    total = pipeline.feed(master.frame()).snapshot.accumulator
    assert [total.voltage_v, total.voltage_min_v, total.voltage_max_v, total.power_w] == [None] * 4
    assert total.voltage_min_cell is None


def test_the_masters_charge_is_floored_to_whole_percent(pipeline):
    soc = (2900).to_bytes(2, "little")
    snapshot = pipeline.feed(CanItem(5_000_000_000, 5, 0x100, soc + bytes(6))).snapshot
    assert snapshot.accumulator.driver_soc_percent == 29


def test_energy_of_a_long_gap_is_not_made_up(pipeline, master):
    pipeline.feed(master.frame())
    before = pipeline.feed(master.frame()).snapshot.accumulator.energy_out_wh
    after = pipeline.feed(master.frame(1_800_000)).snapshot.accumulator.energy_out_wh
    assert after == before


def test_relays_of_which_nothing_is_heard_are_not_said_to_be_open(pipeline, master):
    tx = FIELDS["conf.can_tx_msg_data"]
    first = master.image[tx.offset : tx.offset + tx.size]
    first[16:32] = b"".join(n.to_bytes(2, "little") for n in (420, *[0xFFFF] * 7))  # message 1: the flags' first byte
    master.image[tx.offset : tx.offset + tx.size] = first
    pipeline.feed(master.config())
    pipeline.tick(master.t_ns, 1)
    snapshot = pipeline.feed(CanItem(master.t_ns + 5_000_000_000, 5, 0x100, b"\x01" + bytes(7))).snapshot
    assert snapshot.master.flags.fit is True
    assert snapshot.master.flags.load is None
    assert snapshot.master.state == "unknown"


def test_an_estimator_that_fails_is_told_once_and_begun_anew(master):
    class Broken:
        def start(self, *_):
            raise EstimatorError("no")

    made = []

    def make():
        made.append(Broken() if len(made) < 3 else make_estimator("coulomb", CELL, 96))
        return made[-1]

    chain = Pipeline(MasterSource("serial"), make, filter_name="f", cell_name="c")
    outputs = [chain.feed(master.frame()) for _ in range(5)]
    codes = [e.code for output in outputs for e in output.events]
    assert codes.count("estimator-failed") == 1
    assert np.isnan(outputs[0].snapshot.cells.soc).all()
    assert outputs[0].snapshot.accumulator.current_a == pytest.approx(10)
    assert not np.isnan(outputs[-1].snapshot.cells.soc).any()


def test_an_estimator_made_beforehand_is_the_one_that_is_used(master):
    made = []

    def make():
        made.append(make_estimator("coulomb", CELL, 96))
        return made[-1]

    chain = Pipeline(MasterSource("serial"), make, filter_name="f", cell_name="c")
    chain.warm_up()
    assert len(made) == 1
    assert chain.tick(1, 1).snapshot.estimator.started is False
    assert not np.isnan(chain.feed(master.frame()).snapshot.cells.soc).any()
    assert len(made) == 1


def test_measurements_that_cannot_be_estimated_are_counted(pipeline, master):
    pipeline.feed(master.frame())
    master.set("v", [0] * 96)
    assert pipeline.feed(master.frame()).snapshot.estimator.skipped == 1


def soc_after_a_gap(pipeline, master, gap_ms, drawn_ah=None):
    """Return the mean SOC and sigma before and after a gap in a drive at some 10 A; without `drawn_ah` none counted."""
    master.set("i_fs", [1000])
    if drawn_ah is None:
        master.set("soc", [0])
    for _ in range(50):
        before = pipeline.feed(master.frame()).snapshot.accumulator
    master.set("dod", [round(1e6 * (drawn_ah or 0.0))])
    after = pipeline.feed(master.frame(gap_ms)).snapshot.accumulator
    return before, after


def test_after_a_gap_the_charge_is_less_sure_by_what_may_have_flowed(pipeline, master):
    before, after = soc_after_a_gap(pipeline, master, 600_000)
    assert after.soc_sigma > before.soc_sigma + 0.01


def test_after_a_gap_in_which_the_master_counted_on_the_charge_is_as_sure_as_its_count(pipeline, master):
    before, after = soc_after_a_gap(pipeline, master, 600_000, drawn_ah=2.5)
    assert after.soc_sigma < before.soc_sigma + 0.003
    assert after.soc - before.soc == pytest.approx(-0.1, abs=0.003)


def test_after_a_missing_frame_it_is_not(pipeline, master):
    before, after = soc_after_a_gap(pipeline, master, 300)
    assert after.soc_sigma < before.soc_sigma + 0.001
