"""A table as a source: every row is a measurement at its own time, and its session says what it said."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.live.pipeline_factory import PipelineFactory
from app.sessions.reading.reader import SessionFile
from app.sessions.replay import item_of, prepare
from app.sessions.transfer.import_session import import_file
from app.sources.items import CanItem, TableItem
from app.sources.loaded_battery import LoadedBattery, battery_from_files, load_battery, team_battery
from app.sources.recordings.battery_log import BatteryLog
from app.sources.recordings.import_mapping import ImportMapping
from app.sources.source import NOTHING_RECEIVED
from app.sources.table_source import TableSource, battery_of_table, numbers_of_rows
from tests.campaign import examples

VOLTS = st.floats(0.6, 5.9)
TIMES_S = (0.0, 0.1, 0.15, 5.0, 5.0001, 700.0)
PROFILE = ImportMapping(time="t", current="I", voltages="U{n}", soc="soc", soc_unit="fraction", temperatures="T{n}")


def pipeline(battery: LoadedBattery):
    return PipelineFactory("fused", None, battery).pipeline("replay")


def log_of(volts, *, soc=None, degc=np.nan):
    rows, cells = volts.shape
    known = None if soc is None else np.full(rows, soc)
    return BatteryLog(
        np.arange(rows) * 0.1, None, np.linspace(-5, 5, rows), volts, np.full(volts.shape, degc), known, cells, (), 0.0
    )


def measured(log, times_s=None):
    battery = battery_of_table(log, "their.csv").battery
    source = TableSource(battery)
    found = []
    for time_s, numbers in zip(log.time_s if times_s is None else times_s, numbers_of_rows(log, battery), strict=True):
        found.append(source.feed(TableItem(round(time_s * 1e9), 0, numbers)).measurement)
    return found


@settings(max_examples=examples(30), deadline=None)
@given(st.integers(1, 40).flatmap(lambda n: st.lists(st.lists(VOLTS, min_size=n, max_size=n), min_size=1, max_size=5)))
def test_every_number_is_measured_to_the_last_bit(table):
    log = log_of(np.array(table), soc=0.7123456789, degc=24.0000001)
    found = measured(log)
    np.testing.assert_array_equal([each.voltage_v for each in found], log.voltages_v)
    np.testing.assert_array_equal([each.temperature_degc for each in found], log.temperatures_degc)
    assert [each.current_a for each in found] == log.current_a.tolist()
    assert {each.master.soc for each in found} == {0.7123456789}


def test_steps_are_those_between_the_rows():
    found = measured(log_of(np.full((6, 2), 3.7)), TIMES_S)
    assert found[0].dt_s is None
    assert [each.dt_s for each in found[1:]] == pytest.approx(np.diff(TIMES_S))
    assert all(each.is_sample and each.age_s.voltage == 0.0 for each in found)


def test_a_number_that_is_missing_stays_missing():
    found = measured(log_of(np.array([[3.7, np.nan], [3.6, 3.5]])))
    assert np.isnan([each.voltage_v for each in found]).tolist() == [[False, True], [False, False]]
    assert np.isnan(found[1].temperature_degc).all()
    assert found[1].master.soc is None


def test_what_a_row_does_not_hold_stays_with_its_age():
    volts = np.array([[3.7, 3.8], [np.nan, np.nan], [3.6, np.nan]])
    found = measured(log_of(volts))
    np.testing.assert_array_equal([each.voltage_v for each in found], [[3.7, 3.8], [3.7, 3.8], [3.6, 3.8]])
    np.testing.assert_allclose([each.voltage_age_s for each in found], [[0, 0], [0.1, 0.1], [0, 0.2]], atol=1e-9)


def test_what_no_row_holds_for_long_is_missing():
    volts = np.array([[3.7, 3.8], [3.7, 3.8], [3.7, np.nan], [3.7, np.nan]])
    found = measured(log_of(volts), [0.0, 1.0, 2.0, 5.0])
    assert np.isnan([each.voltage_v for each in found]).tolist() == [[False, False]] * 3 + [[False, True]]


def test_what_is_no_row_of_this_battery_is_nothing():
    source = TableSource(battery_of_table(log_of(np.full((1, 3), 3.7)), "their.csv").battery)
    assert source.feed(TableItem(0, 0, np.zeros(9))) is NOTHING_RECEIVED
    assert source.feed(CanItem(0, 0, 1, bytes(8))) is NOTHING_RECEIVED


def test_a_filter_takes_the_voltages_of_mean_currents_as_means_and_nothing_over_a_gap_or_a_hole():
    volts = np.array([[3.7, 3.7], [3.6, np.nan], [3.5, 3.5], [3.4, 3.4]])
    log = replace(log_of(volts), means_s=1.0)
    battery = battery_of_table(log, "their.csv")
    assert battery_from_files(battery.files).means_s == 1.0
    source = TableSource(battery.battery, means_s=battery.means_s)
    found = [
        source.feed(TableItem(round(time_s * 1e9), 0, numbers)).measurement
        for time_s, numbers in zip((0.0, 1.0, 2.0, 60.0), numbers_of_rows(log, battery.battery), strict=True)
    ]
    shown = np.where(np.isnan(volts), 3.7, volts)  # the hole holds the value before it, and its age
    np.testing.assert_array_equal([each.voltage_v for each in found], shown)
    means = [[3.7, 3.7], [3.65, np.nan], [3.55, 3.5], [3.4, 3.4]]
    np.testing.assert_allclose([each.filter_voltage_v for each in found], means)


def test_shape_cell_drawing_and_limits_are_those_of_the_battery_that_it_is_like():
    team = team_battery().battery
    as_team = battery_of_table(log_of(np.full((1, 96), 3.7)), "their.csv").battery
    assert (as_team.segments, as_team.drawing, as_team.rules) == (team.segments, team.drawing, team.rules)
    orion = load_battery("orion-bms-2")
    like = battery_of_table(log_of(np.full((1, 72), 3.7)), "their.csv", orion).battery
    assert (like.name, like.segments, like.cell) == (orion.battery.name, (12,) * 6, orion.battery.cell)
    alone = battery_of_table(log_of(np.full((1, 7), 3.7)), 'a "quoted" name.csv')
    assert (alone.battery.name, alone.battery.segments) == ('a "quoted" name.csv', (7,))
    assert battery_from_files(alone.files) == alone
    assert alone.battery.n_sensors == 0


def test_a_session_keeps_every_row_at_its_time_and_replays_the_estimates_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "cantools", None)  # as where no extra is installed
    lines = [f"{at_s},{9 + k % 3},{0.5},3.70001,3.8{k},21.5,22" for k, at_s in enumerate(TIMES_S)]
    (tmp_path / "t.csv").write_text("\n".join(["t,I,soc,U1,U2,T1,T2", *lines]))
    done = import_file(tmp_path / "t.csv", PROFILE, tmp_path / "sessions", pipeline)
    with SessionFile(done.info.path) as session:
        assert session.problems() == []
        assert (session.info.frames, session.info.can_frames) == (0, 0)
        assert list(session.battery.segments) == [2]
        start_ns = session.info.started_mono_ns
        assert [(item.t_mono_ns - start_ns) / 1e9 for item in session.measurements()] == pytest.approx(TIMES_S)
        names = ["v[1]", "i_fs", "soc", "t[0]", "v_min", "v_tot", "estimate.soc[1]"]
        for found in session.samples([session.signals.find(name) for name in names]):
            assert (found.track.times_us - start_ns // 1000) / 1e6 == pytest.approx(TIMES_S)
        again = pipeline(session.loaded_battery)
        prepare(again, session)
        soc = [again.feed(item_of(item)).snapshot.cells.soc for item in session.received()]
        recorded = [row[2] for row in session.estimates()]
        np.testing.assert_allclose(recorded, soc, atol=2e-5)


def test_its_profile_is_of_no_battery_that_is_served(tmp_path: Path) -> None:
    battery = battery_of_table(log_of(np.full((1, 3), 3.7)), "their.csv")
    (tmp_path / "table.toml").write_bytes(battery.files["table.toml"])
    with pytest.raises(Exception, match="only sessions of imported tables"):
        load_battery(str(tmp_path / "table.toml"))
