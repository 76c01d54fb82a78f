"""A table as a battery of its own: its frames hold every number, and its profile explains them."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from app.sessions.transfer.table_battery import battery_of_table, frames_of_table
from app.sources.dbc.battery_decoder import BatteryDecoder
from app.sources.dbc.frames import frames_of
from app.sources.loaded_battery import battery_from_files, load_battery, team_battery
from app.sources.recordings.battery_log import BatteryLog
from tests.campaign import examples

VOLTS = st.floats(0.6, 5.9)


def log_of(volts, *, soc=None, degc=np.nan, step_s=0.1):
    rows, cells = volts.shape
    time_s = np.arange(rows) * step_s
    known = None if soc is None else np.full(rows, soc)
    return BatteryLog(time_s, None, np.linspace(-5, 5, rows), volts, np.full(volts.shape, degc), known, cells, ())


def decoded(battery, log):
    frames = frames_of([frame for row in frames_of_table(log) for frame in row])
    return BatteryDecoder(battery.battery, battery.speaks_dbc, battery.definitions).decode(frames)


@settings(max_examples=examples(30), deadline=None)
@given(st.integers(1, 40).flatmap(lambda n: st.lists(st.lists(VOLTS, min_size=n, max_size=n), min_size=1, max_size=5)))
def test_every_number_comes_back_to_the_last_bit(table):
    log = log_of(np.array(table), soc=0.7123456789, degc=24.0000001)
    values = decoded(battery_of_table(log, "their.csv"), log)
    back = values["voltage"]
    found = np.full(log.voltages_v.shape, np.nan)
    found[np.round(back.t_ns / 1e8).astype(int), back.index] = back.value
    np.testing.assert_array_equal(found, log.voltages_v)
    assert values["current"].value.tolist() == log.current_a.tolist()
    assert set(values["soc"].value) == {0.7123456789}
    assert set(values["temperature"].value) == {24.0000001}


def test_what_the_table_does_not_hold_is_in_no_signal():
    log = log_of(np.full((2, 3), 3.7))
    battery = battery_of_table(log, "their.csv")
    assert set(decoded(battery, log)) == {"voltage", "current"}
    assert battery.battery.n_sensors == 0
    assert battery_from_files(battery.files) == battery


def test_a_number_that_is_missing_stays_missing():
    log = log_of(np.array([[3.7, np.nan], [3.6, 3.5]]))
    back = decoded(battery_of_table(log, "their.csv"), log)["voltage"]
    assert np.isnan(back.value).tolist() == [False, True, False, False]


def test_its_period_is_that_of_its_rows():
    for step_s, period_s in ((0.02, 0.02), (5.0, 5.0), (1e-5, 0.001), (600.0, 60.0)):
        speaks = battery_of_table(log_of(np.full((9, 1), 3.7), step_s=step_s), "their.csv").speaks_dbc
        assert speaks is not None
        assert speaks.period_s == period_s


def test_shape_cell_drawing_and_limits_are_those_of_the_battery_that_it_is_like():
    team = team_battery().battery
    as_team = battery_of_table(log_of(np.full((1, 96), 3.7)), "their.csv").battery
    assert (as_team.segments, as_team.drawing, as_team.rules) == (team.segments, team.drawing, team.rules)
    orion = load_battery("orion-bms-2")
    like = battery_of_table(log_of(np.full((1, 72), 3.7)), "their.csv", orion).battery
    assert (like.name, like.segments, like.cell) == (orion.battery.name, (12,) * 6, orion.battery.cell)
    alone = battery_of_table(log_of(np.full((1, 7), 3.7)), 'a "quoted" name.csv').battery
    assert (alone.name, alone.segments) == ('a "quoted" name.csv', (7,))
