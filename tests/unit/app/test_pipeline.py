import numpy as np
import pytest

from app.estimation.cellfile import load_cell
from app.estimation.estimators import make_estimator
from app.pipeline import Pipeline
from app.telemetry import CanItem, LinkChange
from firmware_protocol.framing import decode_chunk
from firmware_protocol.messages import Event, EventCode, Ident, MessageType, Reply

CELL = load_cell("samsung-25r-10p")


@pytest.fixture
def pipeline():
    chain = Pipeline(
        "serial",
        lambda: make_estimator("fused", CELL, 96),
        filter_name="fused",
        cell_name="samsung-25r-10p",
        rs232_url="/dev/x",
        can_url="virtual:x",
    )
    for link in ("rs232", "can"):
        chain.feed(LinkChange(0, 0, link, "open"))
    return chain


def test_a_frame_becomes_a_snapshot_in_units(pipeline, master):
    snapshot = pipeline.feed(master.frame()).snapshot
    assert snapshot.cells.voltage_v[3] == pytest.approx(3.7003)
    assert snapshot.cells.temperature_degc[0] == 25
    total = snapshot.accumulator
    assert total["current_a"] == pytest.approx(10.0)
    assert total["power_w"] == pytest.approx(3552.0)
    assert (total["voltage_min_cell"], total["voltage_max_cell"]) == (0, 95)
    assert snapshot.master["state"] == "drive"
    assert snapshot.links["rs232"].state == "live"


def test_nothing_known_is_missing_and_not_zero(pipeline):
    snapshot = pipeline.tick(1_000_000_000, 1).snapshot
    assert np.isnan(snapshot.cells.voltage_v).all()
    assert np.isnan(snapshot.cells.soc).all()
    known = {"loaded_cells": 0, "energy_out_wh": 0.0, "energy_in_wh": 0.0}
    assert {name: value for name, value in snapshot.accumulator.items() if value is not None} == known
    assert snapshot.master["state"] == "unknown"
    assert set(snapshot.age_s.values()) == {None}
    assert snapshot.alarms == ()


def test_a_cell_that_reads_zero_is_missing_and_not_the_lowest(pipeline, master):
    master.set("v", [0, *[37000] * 95])
    snapshot = pipeline.feed(master.frame()).snapshot
    assert np.isnan(snapshot.cells.voltage_v[0])
    assert snapshot.accumulator["voltage_min_cell"] == 1
    assert snapshot.accumulator["loaded_cells"] == 95
    assert snapshot.packs[0]["voltage_v"] is None
    assert snapshot.packs[1]["voltage_v"] == pytest.approx(12 * 3.7)


def test_values_older_than_ten_seconds_are_gone(pipeline, master):
    pipeline.feed(master.frame())
    recent = pipeline.tick(master.t_ns + 9_000_000_000, 1).snapshot
    old = pipeline.tick(master.t_ns + 11_000_000_000, 1).snapshot
    assert recent.accumulator["current_a"] is not None
    assert recent.age_s["current"] == pytest.approx(9.0)
    assert old.accumulator["current_a"] is None
    assert np.isnan(old.cells.voltage_v).all()
    assert np.isnan(old.cells.soc).all()
    assert old.master["state"] == "unknown"
    assert old.age_s["current"] == pytest.approx(11.0)


def test_charge_follows_the_masters_clock_and_not_arrival(pipeline, master):
    master.set("i_fs", [10000])
    pipeline.feed(master.frame())
    before = pipeline.feed(master.frame()).snapshot.accumulator["energy_out_wh"]
    master.uptime_ms += 3_600
    after = pipeline.feed(master.frame(0)).snapshot.accumulator["energy_out_wh"]
    assert after - before == pytest.approx(float(np.sum([3.7 + i * 1e-4 for i in range(96)])) * 100 * 3.6 / 3600)


def test_a_master_reset_takes_no_charge(pipeline, master):
    master.set("i_fs", [10000])
    pipeline.feed(master.frame())
    before = pipeline.feed(master.frame()).snapshot.accumulator["energy_out_wh"]
    master.uptime_ms = 5
    after = pipeline.feed(master.frame(0)).snapshot
    assert after.accumulator["energy_out_wh"] == before
    assert not np.isnan(after.cells.soc).any()


def test_uptime_wraps_after_49_days(pipeline, master):
    master.set("i_fs", [10000])
    master.uptime_ms = (1 << 32) - 150
    pipeline.feed(master.frame())
    before = pipeline.feed(master.frame(0)).snapshot.accumulator["energy_out_wh"]
    master.uptime_ms = 50
    after = pipeline.feed(master.frame(0)).snapshot.accumulator["energy_out_wh"]
    assert after > before


def test_can_alone_fills_what_its_message_carries(pipeline, master):
    data = bytes([0x10, 0x27, 0xC0, 0x8A]) + (-250).to_bytes(4, "little", signed=True)
    snapshot = pipeline.feed(CanItem(5_000_000_000, 5, 0x100, data)).snapshot
    assert snapshot.accumulator["soc"] == pytest.approx(1.0)
    assert snapshot.accumulator["soc_source"] == "master"
    assert snapshot.accumulator["voltage_v"] == pytest.approx(355.2)
    assert snapshot.accumulator["current_a"] == pytest.approx(-2.5)
    assert np.isnan(snapshot.cells.voltage_v).all()
    assert snapshot.age_s["voltage"] is None
    assert snapshot.links["can"].state == "live"


def test_can_does_not_disturb_a_live_rs232(pipeline, master):
    pipeline.feed(master.frame())
    output = pipeline.feed(CanItem(master.t_ns, 5, 0x100, bytes(8)))
    assert output.snapshot is None
    assert pipeline.tick(master.t_ns + 1, 1).snapshot.accumulator["current_a"] == pytest.approx(10.0)


def test_a_bad_frame_changes_no_field(pipeline, master):
    before = pipeline.feed(master.frame()).snapshot
    good = master.frame().frame.raw
    bad = bytes([*good[:-1], good[-1] ^ 1])
    item = master.frame()
    output = pipeline.feed(type(item)(item.t_mono_ns, item.t_wall_ns, decode_chunk(bad)))
    assert output.snapshot is None
    after = pipeline.tick(item.t_mono_ns, 1).snapshot
    assert after.image == before.image
    assert after.links["rs232"].crc_errors + after.links["rs232"].resyncs == 1


def test_the_master_introduces_itself(pipeline, master):
    ident = Ident((1, 2, 3), boots=7)
    body = Reply(MessageType.IDENT, 4, 0, data=ident.to_bytes()).to_body()
    output = pipeline.feed(master.item(MessageType.REPLY, body))
    assert output.reply.request_sequence == 4
    master_part = pipeline.feed(master.frame()).snapshot.master
    assert (master_part["firmware"], master_part["boots"], master_part["map_matches"]) == ("1.2.3", 7, True)


def test_a_trip_names_cell_value_and_limit(pipeline, master):
    body = Event(EventCode.TRIP_V_MAX, 0, 31, 42100, 42000).to_body()
    event = pipeline.feed(master.item(MessageType.EVENT, body)).events[0]
    assert (event.severity, event.cell) == ("trip", 31)
    assert event.value == pytest.approx(4.21)
    assert "pack 3, cell 8" in event.text
    master.set("status.flags", [0])
    snapshot = pipeline.feed(master.frame()).snapshot
    assert snapshot.master["state"] == "fault"
    assert "4.21" in snapshot.master["why"]


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
        chain = Pipeline("replay", lambda: make_estimator("fused", CELL, 96), filter_name="f", cell_name="c")
        outputs = [chain.feed(item).snapshot for item in items]
        return [(s.image, s.cells.soc.tobytes(), s.accumulator) for s in outputs if s]

    assert run() == run()
