"""Laps lie on each other by the way that a speed or a place tells, else by time."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.analysis.laps.figures import Lap
from app.analysis.laps.from_session import overlay_laps
from app.analysis.laps.place import AUTO, share_of_way
from app.errors import ConfigError
from app.sessions.reading.reader import SessionFile

START_S = 1_790_000_000.0
LAP_S = 60.0
TIME_S = np.arange(0.0, 2 * LAP_S, 0.25)
SLOW_S = 40.0  # the second lap stands still for so long in its middle
LAPS = [Lap(START_S, START_S + LAP_S), Lap(START_S + LAP_S, START_S + 2 * LAP_S)]
SPEED_FRAME = "can:0x320:1"


def speed_at(time_s: float) -> int:
    return 0 if LAP_S + 10.0 <= time_s < LAP_S + 10.0 + SLOW_S else 1500


@pytest.fixture
def path(make_session):
    """Two laps; a current of 100 A in the second half of the way of each."""
    way_s = np.where(TIME_S < LAP_S, TIME_S / LAP_S, np.minimum(TIME_S - LAP_S, 10) / 20)
    way_s = np.where(TIME_S >= LAP_S + 10 + SLOW_S, 0.5 + (TIME_S - LAP_S - 10 - SLOW_S) / 20, way_s)
    can = [(t, 0x320, bytes([9]) + speed_at(t).to_bytes(2, "little")) for t in TIME_S]
    return make_session(TIME_S, np.where(way_s > 0.5, 100.0, 0.0), can=can)


def begins_at(trace) -> float:
    """Where in the lap the current begins, 0..1."""
    return next(k for k, value in enumerate(trace.maximum) if value is not None and value > 50) / len(trace.maximum)


def test_a_lap_with_a_stop_lies_on_another_by_its_speed_but_not_by_time(path):
    with SessionFile(path) as session:
        by_time = overlay_laps(session, LAPS, [0, 1], "current_a", 40)
        by_way = overlay_laps(session, LAPS, [0, 1], "current_a", 40, SPEED_FRAME)
    assert (by_time.along, by_way.along) == (None, SPEED_FRAME)
    assert begins_at(by_time.laps[1]) > 0.8
    assert [begins_at(trace) for trace in by_way.laps] == pytest.approx([0.5, 0.5], abs=0.06)


def test_where_no_speed_is_known_laps_lie_on_each_other_by_time(path):
    with SessionFile(path) as session:
        found = overlay_laps(session, LAPS, [0, 1], "current_a", 40, AUTO)
        assert (found.along, found.places) == (None, [])
        for name in ("can:0x321:0", "can:0x320:7"):
            with pytest.raises(ConfigError, match="changes in every lap"):
                overlay_laps(session, LAPS, [0, 1], "current_a", 40, name)
        with pytest.raises(ConfigError, match="along"):
            overlay_laps(session, LAPS, [0, 1], "current_a", 40, "wheels")


@given(st.lists(st.floats(0.1, 300.0), min_size=2, max_size=30), st.floats(0.01, 50.0))
def test_the_unit_of_a_speed_does_not_matter_and_the_way_rises_from_0_to_1(speeds: list[float], factor: float):
    time_s, values = np.arange(float(len(speeds))), np.array(speeds)
    share = share_of_way(time_s, values, time_s)
    assert share is not None
    assert (share[0], share[-1]) == (0.0, 1.0)
    assert np.all(np.diff(share) >= 0.0)
    np.testing.assert_allclose(share_of_way(time_s, values * factor, time_s), share, atol=1e-9)


def test_a_lap_fraction_is_the_way_itself_also_where_it_begins_again():
    time_s = np.arange(101.0)
    fraction = (0.02 + time_s / 100) % 1.0
    share = share_of_way(time_s, fraction, time_s)
    assert share == pytest.approx(time_s / 100, abs=0.02)


@pytest.mark.parametrize("values", [[], [1.0], [0.0, 0.0, 0.0], [float("nan")] * 3])
def test_what_does_not_move_tells_no_way(values):
    assert share_of_way(np.arange(float(len(values))), np.array(values), np.zeros(1)) is None
