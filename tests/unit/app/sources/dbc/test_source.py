import numpy as np
import pytest

from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.source import DbcSource
from app.sources.items import CanItem, LinkChange
from tests.peer_batteries import one_signal_a_cell, segments_in_fd_frames
from tests.unit.app.sources.dbc.test_battery_decoder import CURRENT, battery_and_source

CURRENT_FD = CURRENT.replace("BMS_PackStatus", "AMS_Status").replace("Pack_Current", "TS_Current").replace(
    "Pack_Voltage", "TS_Voltage"
).replace("Pack_SOC", "SOC").replace('positive = "discharge"', 'positive = "charge"')  # fmt: skip


def source_of(peer, more=CURRENT):
    battery, source = battery_and_source(peer.profile, peer.n_cells, peer.n_sensors, peer.segments, more)
    return DbcSource(battery, source, parse_definitions(peer.dbc().encode(), "x.dbc"), "virtual:x")


def fed(source, frames):
    found = [source.feed(CanItem(t, 10**18 + t, can_id, data)).measurement for t, can_id, data in frames]
    return [measurement for measurement in found if measurement is not None]


@pytest.mark.parametrize("make", [lambda: one_signal_a_cell(90, 45, "V{}", "T{}", 0.0001, "V"), segments_in_fd_frames])
def test_frames_of_any_shape_become_measurements_with_their_own_times(make):
    peer = make()
    source = source_of(peer, CURRENT if peer.n_cells == 90 else CURRENT_FD)
    found = fed(source, peer.frames(4))
    assert len(found) == pytest.approx(40, abs=2)
    last = found[-1]
    assert last.voltage_v.shape == (peer.n_cells,)
    assert last.temperature_degc.shape == (peer.n_cells,)
    assert np.isfinite(last.voltage_v).all()
    assert np.isfinite(last.temperature_degc).all()
    assert last.is_sample
    assert last.dt_s == pytest.approx(0.1, abs=0.11)
    assert last.current_a is not None
    assert last.age_s.voltage < 0.5
    assert last.master.soc == pytest.approx(0.64)
    assert last.links.can.frames > 100


def test_a_silent_bus_gives_nothing_new_and_ends_in_missing_values():
    peer = one_signal_a_cell(8, 8, "V{}", "T{}", 0.0001, "V")
    source = source_of(peer)
    fed(source, peer.frames(2))
    now_ns = 10_000_000_000
    source.measure(now_ns, now_ns)
    later = source.measure(now_ns + 1_000_000_000, now_ns)
    assert not later.is_fresh
    assert not later.is_sample
    assert np.isnan(later.voltage_v).all()
    assert later.current_a is None


def test_before_the_first_frame_all_is_missing():
    found = source_of(one_signal_a_cell(8, 0, "V{}", "T{}", 0.0001, "V"), "").measure(1, 1)
    assert np.isnan(found.voltage_v).all()
    assert found.current_a is None
    assert found.limits is None
    assert found.master.state == "unknown"
    assert not found.relays_open


def test_what_the_service_sent_itself_is_no_measurement():
    peer = one_signal_a_cell(8, 0, "V{}", "T{}", 0.0001, "V")
    source = source_of(peer, "")
    for t, can_id, data in peer.frames(2):
        assert source.feed(CanItem(t, t, can_id, data, sent=True)).measurement is None


def test_a_lost_bus_is_told_once():
    source = source_of(one_signal_a_cell(8, 0, "V{}", "T{}", 0.0001, "V"), "")
    source.feed(LinkChange(0, 0, "can", "open"))
    lost = LinkChange(1, 1, "can", "lost", "unplugged")
    assert [event.code for event in source.feed(lost).events] == ["can-lost"]
    assert source.feed(lost).events == ()
