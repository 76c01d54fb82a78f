import json
from dataclasses import asdict, replace

import numpy as np
import pytest

from app.analysis.black_box.box import Beyond, box_from_json
from app.analysis.black_box.excerpt import BoxWindow, build
from app.analysis.incidents import AFTER_S, FOLLOWS_S, Trigger, incident_id, incidents, is_trigger, main_trigger

WALL_S = 1_790_000_000.0
TIME_S = np.arange(90.0, 105.05, 0.1)
CELL = 30


def window(voltage_v=3.5, **changes):
    n = len(TIME_S)
    volts = np.full((n, 96), 3.5)
    volts[:, CELL] = voltage_v
    values = {
        "mono_s": TIME_S,
        "current_a": np.full(n, 120.0),
        "voltage_v": volts,
        "temperature_degc": np.full((n, 96), 30.0),
        "soc": np.full((n, 96), 0.5),
        "fit": (TIME_S < 100.45).astype(float),
        "load": (TIME_S < 100.45).astype(float),
    }
    return BoxWindow(**values | changes)


def trigger(at_s=100.0, code="trip-cell-undervoltage", severity="trip", cell=CELL, value=2.4, limit=2.5, unit="V"):
    return Trigger(WALL_S + at_s, at_s, code, severity, "cell under-voltage", cell, value, limit, unit)


def boxed(group=None, around=None):
    return build(
        group or [trigger()],
        around or window(),
        session_id="s",
        config_hash="ab",
        limits={"v_cell_min": 2.5},
        segments=[12] * 8,
    )


def test_it_says_how_far_and_how_long_a_cell_was_beyond_its_limit():
    volts = np.where((TIME_S > 99.35) & (TIME_S < 101.05), 2.3, 3.4)
    volts[TIME_S < 92] = 2.2  # an earlier dip is not this one
    box = boxed(around=window(volts))
    assert box.beyond == Beyond(
        since_s=pytest.approx(-0.6), lasted_s=pytest.approx(1.7), ended=True, worst=pytest.approx(2.3)
    )
    assert box.peers.also_beyond == 0
    assert box.peers.apart == pytest.approx(2.3 - 3.5)
    assert box.cells.opened_s == pytest.approx(0.5)
    assert "Pack 3, cell 7 was beyond the limit of 2.5 V for 1.7 s" in " ".join(each.text for each in box.findings)


def test_one_that_never_recovers_is_said_to_be_still_beyond():
    box = boxed(around=window(np.where(TIME_S > 99.95, 2.3, 3.4)))
    assert box.beyond.ended is False
    assert "until the end of the recording" in " ".join(each.text for each in box.findings)


def test_a_box_over_can_alone_says_that_no_cell_was_heard():
    unknown = np.full((len(TIME_S), 96), np.nan)
    around = replace(window(), voltage_v=unknown, temperature_degc=unknown, soc=unknown)
    box = boxed(around=around)
    assert "CAN alone carries only" in " ".join(each.text for each in box.findings)
    assert box.cells.current_at_trip_a == 120.0
    assert "CAN alone carries only" not in " ".join(each.text for each in boxed().findings)


def test_a_limit_that_was_not_seen_to_be_passed_is_said_so():
    box = boxed(around=window(2.6))
    assert box.beyond.since_s is None
    assert "No recorded sample exceeded the limit" in " ".join(each.text for each in box.findings)


def test_a_hot_cell_and_a_current_are_judged_by_their_own_values():
    heat = np.full((len(TIME_S), 96), 30.0)
    heat[:, CELL] = 61.0
    heat[:, CELL + 1] = 60.5
    hot = boxed([trigger(code="cell-overtemperature", value=61, limit=60, unit="degC")], window(temperature_degc=heat))
    assert (hot.quantity, hot.side, hot.peers.also_beyond) == ("temperature", "high", 1)
    amps = np.where(TIME_S > 99.75, 250.0, 100.0)
    high = boxed(
        [trigger(code="discharge-overcurrent", cell=None, value=250, limit=200, unit="A")], window(current_a=amps)
    )
    assert (high.quantity, high.peers, high.beyond.worst) == ("current", None, 250)
    assert high.beyond.since_s == pytest.approx(-0.2)


def test_what_follows_within_seconds_is_the_same_incident():
    alarm = trigger(99.9, "master-fault", cell=None, value=None, limit=None, unit="")
    groups = incidents([trigger(200.0), trigger(100.0), alarm, trigger(100.0 + AFTER_S + 0.1)])
    assert [[each.mono_s for each in group] for group in groups] == [[99.9, 100.0], [105.1], [200.0]]
    assert main_trigger(groups[0]).code == "trip-cell-undervoltage"
    warning = trigger(99.0, "joint-resistance-high", "warning")
    assert main_trigger([warning, *groups[0]]).code == "trip-cell-undervoltage"
    many = incidents([trigger(100.0 + k) for k in range(40)])
    assert all(group[-1].mono_s - group[0].mono_s <= 15 for group in many)


def test_a_finding_of_the_cell_that_tripped_is_no_incident_of_its_own():
    late = 100.0 + FOLLOWS_S + 1
    found = [trigger(at_s, "joint-resistance-high", "warning") for at_s in (110.0, late)]
    other = trigger(120.0, "joint-resistance-high", "warning", cell=CELL + 1)
    groups = incidents([trigger(100.0), *found, other])
    assert [(each.mono_s, each.cell) for (each,) in groups] == [(100.0, CELL), (120.0, CELL + 1), (late, CELL)]


def test_its_name_is_the_time_in_utc_and_the_code():
    assert incident_id(trigger(100.25)) == "20260921T141500.250Z-trip-cell-undervoltage"


@pytest.mark.parametrize(
    ("severity", "code", "expected"),
    [
        ("trip", "anything", True),
        ("warning", "joint-resistance-high", True),
        ("warning", "charger-hardware-fault", True),
        ("warning", "rs232-lost", False),
        ("watch", "joint-resistance-high", False),
        ("info", "cell-voltage-missing", False),
    ],
)
def test_trips_and_faults_of_the_battery_are_worth_one(severity, code, expected):
    assert is_trigger(severity, code) is expected


@pytest.mark.parametrize("n", [0, 1, 30])
def test_without_all_samples_it_is_incomplete_and_still_json(n):
    part = window(np.nan)
    cut = BoxWindow(**{name: getattr(part, name)[:n] for name in part.__dataclass_fields__})
    box = boxed(around=cut)
    assert box.is_complete is False
    stored = json.loads(json.dumps(asdict(box), allow_nan=False))
    assert box_from_json(stored) == box
    assert boxed().is_complete is True


def test_every_sample_of_every_cell_is_in_it():
    box = boxed(around=window(np.linspace(3.6, 3.4, len(TIME_S))))
    assert len(box.samples.voltage_v) == 96
    assert box.samples.voltage_v[CELL] == pytest.approx(np.linspace(3.6, 3.4, len(TIME_S)), abs=1e-4)
    assert box.samples.time_s[0] == pytest.approx(-10)
    assert box.rate_hz == pytest.approx(10, abs=0.1)


def test_a_box_of_a_simulated_car_says_so_and_one_of_before_is_none():
    box = build(
        [trigger()], window(), session_id=None, config_hash=None, limits={}, segments=[12] * 8, is_simulated=True
    )
    assert box.simulated is True
    older = json.loads(json.dumps(asdict(box)))
    del older["simulated"]
    assert box_from_json(older).simulated is False
