from dataclasses import replace

import numpy as np
import pytest

from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.source import DbcSource
from app.sources.items import CanFault, CanItem, LinkChange
from tests.peer_batteries import cell_number, one_signal_a_cell
from tests.peer_messages import HEAD
from tests.unit.app.sources.dbc.test_battery_decoder import CURRENT, battery_and_source


def source_of(peer, more=CURRENT):
    battery, source = battery_and_source(peer.profile, peer.n_cells, peer.n_sensors, peer.segments, more)
    return DbcSource(battery, source, parse_definitions(peer.dbc().encode(), "x.dbc"), "virtual:x")


def fed(source, frames):
    found = [source.feed(CanItem(t, 10**18 + t, can_id, data)).measurement for t, can_id, data in frames]
    return [measurement for measurement in found if measurement is not None]


def test_frames_become_measurements_with_their_own_times():
    peer = one_signal_a_cell(90, 45, "V{}", "T{}", 0.0001, "V")
    source = source_of(peer)
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


S = 1_000_000_000
STATE_DBC = (
    HEAD
    + "BO_ 1 Cells: 8 BMS\n"
    + "".join(f' SG_ V{k + 1} : {16 * k}|16@1+ (0.001,0) [0|5] "V" X\n' for k in range(4))
    + """BO_ 2 Pack: 8 BMS
 SG_ I : 0|16@1- (0.1,0) [0|0] "A" X
 SG_ U : 16|16@1+ (0.1,0) [0|0] "V" X
 SG_ SOC : 32|8@1+ (0.5,0) [0|100] "%" X
 SG_ State : 40|8@1+ (1,0) [0|0] "" X
 SG_ Faults : 48|8@1+ (1,0) [0|0] "" X
 SG_ MaxDischarge : 56|8@1+ (2,0) [0|0] "A" X

BO_ 3 Charger: 4 BMS
 SG_ Charger_U : 0|16@1+ (0.1,0) [0|0] "V" X
 SG_ Charger_I : 16|16@1- (0.1,0) [0|0] "A" X

BO_ 4 More: 4 BMS
 SG_ Bal1 : 0|1@1+ (1,0) [0|1] "" X
 SG_ Bal2 : 1|1@1+ (1,0) [0|1] "" X
 SG_ Bal3 : 2|1@1+ (1,0) [0|1] "" X
 SG_ Bal4 : 3|1@1+ (1,0) [0|1] "" X
 SG_ R1 : 8|8@1+ (0.1,0) [0|0] "mOhm" X
"""
)
STATE_PROFILE = """[[source.voltage]]
signal = "V{cell}"
base = 1
[[source.balancing]]
signal = "Bal{cell}"
base = 1
[[source.resistance]]
signal = "R{cell}"
base = 1
[source.current]
signal = "I"
[source.pack_voltage]
signal = "U"
[source.soc]
signal = "SOC"
[source.charger_voltage]
signal = "Charger_U"
[source.charger_current]
signal = "Charger_I"
[source.state.closed]
signal = "State"
equals = [2, 3, 4]
[source.state.charging]
signal = "State"
equals = [3]
[source.state.balancing]
signal = "State"
equals = [4]
[source.state.fault]
signal = "Faults"
mask = 6
"""
LIMITS = """[battery.limits]
cell_voltage_min_v = 2.8
cell_voltage_max_v = 4.2
temperature_min_degc = -10
temperature_max_degc = 60
charge_current_max_a = 40
discharge_current_max_a = { signal = "MaxDischarge" }
"""


def told(state=2, faults=0, limit=100, current=125, at_s=0.0, volts=(3700, 3710, 3720, 3730)):
    """Frames of one instant: cells and pack."""
    pack = current.to_bytes(2, "little", signed=True) + (148).to_bytes(2, "little") + bytes([80, state, faults, limit])
    cells = b"".join(volt.to_bytes(2, "little") for volt in volts)
    return [(round(at_s * S) + 1, 1, cells), (round(at_s * S) + 2, 2, pack)]


def state_source(more=""):
    battery, source = battery_and_source(STATE_PROFILE, 4, 0, None, more)
    return DbcSource(battery, source, parse_definitions(STATE_DBC.encode(), "x.dbc"), "virtual:x")


def measured(frames, more="", after_s=0.1):
    source = state_source(more)
    fed(source, frames)
    now_ns = frames[-1][0] + round(after_s * S)
    return source.measure(now_ns, 10**18 + now_ns)


@pytest.mark.parametrize(
    ("state", "faults", "expected", "is_open"),
    [
        (2, 0, "drive", False),
        (3, 0, "charge", False),
        (4, 0, "balance", False),
        (1, 0, "idle", True),
        (2, 2, "fault", False),
        (1, 4, "fault", True),
        (3, 8, "charge", False),  # not one of the bits of the mask
    ],
)
def test_the_state_is_what_the_bms_tells_a_fault_before_all(state, faults, expected, is_open):
    found = measured(told(state, faults))
    assert (found.master.state, found.relays_open) == (expected, is_open)
    assert found.master.fit == (expected != "fault")
    assert found.master.why.code == "bms-state"


def test_a_profile_without_states_claims_none():
    battery, source = battery_and_source(STATE_PROFILE.partition("[source.state.closed]")[0], 4, 0)
    silent = DbcSource(battery, source, parse_definitions(STATE_DBC.encode(), "x.dbc"))
    fed(silent, told(state=1, faults=6))
    found = silent.measure(S // 5, S)
    assert (found.master.state, found.master.fit, found.relays_open) == ("unknown", None, False)
    assert found.master.why.code == "bms-no-state"


def test_every_reading_comes_in_si_units():
    charger = (3999).to_bytes(2, "little") + (-75).to_bytes(2, "little", signed=True)
    found = measured([*told(), (3, 3, charger), (4, 4, bytes([0b0101, 21, 0, 0]))])
    assert found.current_a == pytest.approx(12.5)
    assert found.reported.voltage_v == pytest.approx(14.8)
    assert found.master.soc == pytest.approx(0.4)
    assert (found.charger.voltage_v, found.charger.current_a) == pytest.approx((399.9, -7.5))
    np.testing.assert_allclose(found.voltage_v, [3.7, 3.71, 3.72, 3.73])
    np.testing.assert_allclose(found.resistance_ohm, [0.0021, np.nan, np.nan, np.nan])
    assert list(found.balancing) == [True, False, True, False]


def test_what_was_never_told_is_missing_and_not_zero():
    found = measured(told())
    assert found.balancing is None
    assert (found.charger.voltage_v, found.charger.current_a) == (None, None)
    assert np.isnan(found.resistance_ohm).all()
    assert np.isnan(found.temperature_degc).all()
    assert found.age_s.temperature is None
    assert found.slave_status == (None,)


def test_a_limit_is_that_of_the_profile_or_what_the_bms_tells_now():
    limits = measured(told(limit=90), LIMITS).limits
    assert (limits.discharge_max_a, limits.discharge_min_a) == (180.0, -40.0)
    assert (limits.cell_voltage_min_v, limits.cell_voltage_max_v) == (2.8, 4.2)
    some = measured(told(), LIMITS.replace("temperature_max_degc = 60\n", "")).limits
    assert np.isnan(some.temperature_max_degc)
    assert some.cell_voltage_max_v == 4.2
    assert measured(told(), "").limits is None
    fixed = LIMITS.replace('{ signal = "MaxDischarge" }', "150")
    assert measured(told(), fixed).limits.discharge_max_a == 150.0
    assert state_source(fixed).measure(1, 1).limits.cell_voltage_max_v == 4.2, "before anything was heard"


def test_a_limit_that_the_bms_does_not_tell_any_more_is_no_limit():
    source = state_source(LIMITS)
    fed(source, [frame for k in range(10) for frame in told(at_s=0.1 * k)])
    assert source.measure(S, S).limits.discharge_max_a == 200.0
    assert np.isnan(source.measure(20 * S, 20 * S).limits.discharge_max_a)


def test_a_measurement_follows_the_first_frame_of_the_next_period():
    source = state_source()
    assert fed(source, told(at_s=0.0)) == []
    assert fed(source, told(at_s=0.05)) == []
    (one,) = fed(source, told(at_s=0.12))
    assert (one.uptime_ms, one.is_sample, one.is_fresh, one.dt_s) == (100, True, True, None)
    (two,) = fed(source, told(at_s=0.2, volts=(3600,) * 4))
    assert two.dt_s == pytest.approx(0.1)
    np.testing.assert_allclose(two.voltage_v, [3.7, 3.71, 3.72, 3.73])  # what came after the period ended is not in it


def test_between_two_samples_time_goes_on_where_a_period_brought_no_current():
    source = state_source()
    fed(source, told(at_s=0.0))
    cells_only = [frame for k in (0.1, 0.2) for frame in told(at_s=k) if frame[1] == 1]
    assert [m.is_sample for m in fed(source, cells_only)] == [True, False]
    found = fed(source, [*told(at_s=0.3), *told(at_s=0.4)])
    assert [m.dt_s for m in found if m.is_sample] == pytest.approx([0.3])


def test_frames_of_others_on_the_bus_change_nothing_but_the_load():
    alone, among = state_source(), state_source()
    fed(alone, told())
    fed(among, [(0, 0x7F0, bytes(8)), *told(), (5, 0x80000001, b"\xff" * 8), (6, 0x1, b"")])
    one, other = alone.measure(S // 5, S), among.measure(S // 5, S)
    np.testing.assert_array_equal(one.voltage_v, other.voltage_v)
    assert one.current_a == other.current_a
    assert other.links.can.frames == one.links.can.frames + 3


def test_changes_of_its_link_are_events_once_and_those_of_another_none():
    source = state_source()

    def told(link, state, error=None):
        return [event.code for event in source.feed(LinkChange(0, 0, link, state, error)).events]

    assert told("rs232", "open") == told("can", "connecting") == []
    assert told("can", "open") == ["can-open"]
    source.feed(CanFault(1, 1, "passive", 12, 130, 4))
    assert source.measure(S // 5, S).links.can.bus_state == "passive"
    assert told("can", "lost", "unplugged") == ["can-lost"]
    assert told("can", "lost", "unplugged") == []


def test_only_voltages_that_came_since_the_sample_before_are_new_and_each_has_its_age():
    peer = cell_number()  # one cell every 0.1 s
    found = fed(source_of(peer), peer.frames(9))
    last = found[-1]
    assert 1 <= last.is_new.sum() <= 2
    np.testing.assert_array_equal(np.isfinite(last.new_voltage_v), last.is_new)
    assert np.isfinite(last.voltage_v).all()
    assert last.voltage_age_s.max() == pytest.approx(7.2, abs=0.4)
    assert last.age_s.voltage < 0.3


def test_a_battery_that_speaks_once_a_second_is_sampled_each_time_when_its_period_ends():
    source = state_source()
    for second in range(3):
        fed(source, told(at_s=second + 0.03))
        assert source.due_ns == second * S + S // 10
        found = source.measure(source.due_ns, 1)
        assert (found.is_sample, found.is_fresh) == (True, True)
        assert found.dt_s == (None if second == 0 else pytest.approx(1.0))
        assert source.due_ns is None
    assert not source.measure(3 * S, 1).is_sample


def test_a_look_before_the_period_ends_takes_nothing_from_it_and_after_it_nothing_is_new_a_second_time():
    source = state_source()
    fed(source, told(at_s=0.03))
    assert not source.measure(S // 20, 1).is_fresh
    found = source.measure(S // 10 + 5, 1)
    assert (found.is_fresh, found.is_sample) == (True, True)
    again = source.measure(S // 10 + 9, 1)
    assert (again.is_fresh, again.is_sample) == (False, False)
    np.testing.assert_allclose(again.voltage_v, [3.7, 3.71, 3.72, 3.73])


def test_a_part_is_live_as_long_as_it_usually_takes_to_come_again():
    source = state_source()
    fed(source, [frame for k in range(40) for frame in told(at_s=0.5 * k)])
    found = source.measure(20 * S, 1)
    assert found.live_s.voltage == pytest.approx(1.5, abs=0.35)
    assert found.live_s.status == pytest.approx(1.5, abs=0.35)
    assert (found.live_s.temperature, found.live_s.charger) == (None, None)
    assert found.age_s.status == pytest.approx(0.5, abs=0.1)
    assert found.age_s.soc == pytest.approx(0.5, abs=0.1)
    assert found.age_s.charger is None
    quick = state_source()
    fed(quick, [frame for k in range(40) for frame in told(at_s=0.1 * k)])
    assert quick.measure(4 * S, 1).live_s.voltage == 1.0


def test_cells_of_the_first_round_are_awaited_and_after_it_they_are_missing():
    peer = cell_number()  # 72 cells in 7.2 s
    source = source_of(peer)
    frames = peer.frames(20)
    first = fed(source, [frame for frame in frames if frame[0] < 5 * S])[-1]
    assert first.awaited.sum() == np.isnan(first.voltage_v).sum() > 10
    assert fed(source, [frame for frame in frames if 5 * S <= frame[0] < 9 * S])[-1].awaited is None
    without_one = [(t, i, data) for t, i, data in frames if not (i == 0x036 and data[0] == 40)]
    last = fed(source_of(peer), without_one)[-1]
    assert last.awaited is None
    assert np.flatnonzero(np.isnan(last.voltage_v)).tolist() == [40]


def test_no_cell_is_awaited_for_ever():
    source = state_source()
    source.feed(CanItem(0, 1, 1, bytes(2)))  # two cells of four
    assert source.measure(S, 1).awaited.sum() == 3
    assert source.measure(59 * S, 1).awaited is not None
    assert source.measure(61 * S, 1).awaited is None


@pytest.mark.parametrize(
    ("url", "profile", "expected"),
    [
        ("slcan:/dev/ttyACM0", None, None),
        ("slcan:/dev/ttyACM0?bitrate=250000", None, 250_000),
        ("slcan:/dev/ttyACM0?bitrate=250000", 1_000_000, 1_000_000),
    ],
)
def test_the_load_is_a_share_of_the_bit_rate_that_is_told_and_of_no_guess(url, profile, expected):
    peer = one_signal_a_cell(8, 0, "V{}", "T{}", 0.0001, "V")
    battery, source = battery_and_source(peer.profile, peer.n_cells, peer.n_sensors, peer.segments, "")
    source = DbcSource(battery, replace(source, bit_rate=profile), parse_definitions(peer.dbc().encode(), "x.dbc"), url)
    fed(source, peer.frames(2))
    status = source.measure(2_000_000_000, 2_000_000_000).links.can
    if expected is None:
        assert status.line_load is None
    else:
        bits = status.rate_hz * 135  # bits of a frame with eight bytes and the most stuffing
        assert status.line_load == pytest.approx(bits / expected, rel=0.05)
