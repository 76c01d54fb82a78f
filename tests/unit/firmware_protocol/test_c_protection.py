from dataclasses import replace

import pytest

from firmware_protocol.config_image import default_image
from firmware_protocol.messages import NO_OFFSET, EventCode
from simulator.bms_state import Latch
from tests.c_master import CProtection, Reading
from tests.master_memory import Config

CHARGE_TOLERANCE = 100  # as in vw_protection.h
FAST_PERSISTENCE_S, SLOW_PERSISTENCE_S, WIRE_PERSISTENCE_S, SENSOR_PERSISTENCE_S = 0.3, 0.4, 0.5, 1.0
CURRENT_PERSISTENCE_S = 0.18  # by the default `ts`
CONFIG = Config.from_image(default_image())
GOOD = Reading(
    v_min=36_000, v_min_id=3, v_max=40_000, v_max_id=7, t_min=20, t_min_id=1, t_max=30, t_max_id=9, i_fc=5_000,
    is_charging=False, lost_cell=None, lost_temperature=None, lost_slave=None, lost_current=False,
)  # fmt: skip


def trip_time_s(reading: Reading, step_s: float = 0.02) -> tuple[float, int, int]:
    protection = CProtection(Latch())
    for tick in range(200):
        events = protection.judge(CONFIG, reading, tick * step_s)
        if events:
            return tick * step_s, events[0].code, events[0].cell
    raise AssertionError("no trip")


@pytest.mark.parametrize(
    ("changes", "code", "cell", "after_s"),
    [
        ({"v_min": 24_999}, EventCode.TRIP_V_MIN, 3, FAST_PERSISTENCE_S),
        ({"v_max": 42_001}, EventCode.TRIP_V_MAX, 7, FAST_PERSISTENCE_S),
        ({"t_min": -16}, EventCode.TRIP_T_MIN, 1, SLOW_PERSISTENCE_S),
        ({"t_max": 46}, EventCode.TRIP_T_MAX, 9, SLOW_PERSISTENCE_S),
        ({"i_fc": 20_001}, EventCode.TRIP_I_DISC, NO_OFFSET, CURRENT_PERSISTENCE_S),
        ({"i_fc": -10_001}, EventCode.TRIP_I_DISC, NO_OFFSET, CURRENT_PERSISTENCE_S),
        (
            {"i_fc": -1_200 - CHARGE_TOLERANCE - 1, "is_charging": True},
            EventCode.TRIP_I_CHRG,
            NO_OFFSET,
            CURRENT_PERSISTENCE_S,
        ),
        ({"i_fc": 500, "is_charging": True}, EventCode.TRIP_I_CHRG, NO_OFFSET, CURRENT_PERSISTENCE_S),
        ({"lost_slave": 2}, EventCode.TRIP_SLAVE_LOST, 24, FAST_PERSISTENCE_S),
        ({"lost_cell": 40}, EventCode.TRIP_SENSOR_LOST, 40, WIRE_PERSISTENCE_S),
        ({"lost_temperature": 41}, EventCode.TRIP_SENSOR_LOST, 41, SENSOR_PERSISTENCE_S),
        ({"lost_current": True}, EventCode.TRIP_SENSOR_LOST, NO_OFFSET, FAST_PERSISTENCE_S),
    ],
)
def test_each_limit_trips_after_its_persistence(changes, code, cell, after_s):
    assert trip_time_s(replace(GOOD, **changes)) == (pytest.approx(after_s), code, cell)


@pytest.mark.parametrize(
    "changes",
    [
        {"v_min": 25_000},
        {"v_max": 42_000},
        {"t_min": -15},
        {"t_max": 45},
        {"i_fc": 20_000},
        {"i_fc": -10_000},
        {"i_fc": -1_200, "is_charging": True},
    ],
)
def test_a_value_at_its_limit_is_allowed(changes):
    protection = CProtection(Latch())
    at_limit = replace(GOOD, **changes)
    assert [protection.judge(CONFIG, at_limit, now_s) for now_s in (0.0, 5.0)] == [[], []]
    assert protection.clear()


@pytest.mark.parametrize(
    ("ts", "fc_avg", "after_s"),
    [
        (1, 1, 0.3),
        (40, 10, 0.3),
        (50, 10, 0.28),
        (100, 0, 0.18),  # 400 ms less a pass of 20, a mean of 100, and as long again until that begins
        (100, 100, 0.18),
        (100, 101, 0.08),  # two buffers
        (200, 200, 0.0),
        (1, 1000, 0.0),
    ],
)
def test_what_the_mean_of_the_current_takes_is_left_out_of_its_persistence(ts, fc_avg, after_s):
    config = replace(CONFIG, ts=ts, fc_avg=fc_avg)
    high = replace(GOOD, i_fc=20_001)
    protection = CProtection(Latch())
    trips = [bool(protection.judge(config, high, tick * 0.02)) for tick in range(20)]
    assert trips.index(True) * 0.02 == pytest.approx(after_s)


def test_a_violation_that_ends_in_time_does_not_trip_and_the_next_starts_anew():
    protection = CProtection(Latch())
    bad = replace(GOOD, v_min=20_000)
    for start_s in (0.0, 1.0):
        assert protection.judge(CONFIG, bad, start_s) == []
        assert protection.judge(CONFIG, bad, start_s + 0.28) == []
        assert protection.judge(CONFIG, GOOD, start_s + 0.29) == []
    assert protection.is_ok


def test_a_trip_stays_until_cleared_and_cannot_be_cleared_while_it_lasts():
    protection = CProtection(Latch())
    bad = replace(GOOD, t_max=60)
    protection.judge(CONFIG, bad, 0.0)
    assert len(protection.judge(CONFIG, bad, 1.0)) == 1
    assert protection.judge(CONFIG, bad, 2.0) == []  # told once
    assert not protection.clear()
    protection.judge(CONFIG, GOOD, 3.0)
    assert not protection.is_ok
    assert protection.clear()
    assert protection.is_ok


def test_two_faults_at_once_are_both_told():
    protection = CProtection(Latch())
    bad = replace(GOOD, v_min=20_000, i_fc=30_000)
    protection.judge(CONFIG, bad, 0.0)
    codes = {event.code for event in protection.judge(CONFIG, bad, 0.5)}
    assert codes == {EventCode.TRIP_V_MIN, EventCode.TRIP_I_DISC}


def test_a_restart_does_not_close_the_latch():
    latch = Latch()
    before = CProtection(latch)
    bad = replace(GOOD, t_max=60)
    before.judge(CONFIG, bad, 0.0)
    before.judge(CONFIG, bad, 1.0)
    after = CProtection(latch)
    after.judge(CONFIG, GOOD, 2.0)
    assert not after.is_ok
    assert after.clear()
    assert after.is_ok
    assert before.is_ok
