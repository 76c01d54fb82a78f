"""A table and a profile make a recording in our units; what was left out, sorted or spread is said."""

from dataclasses import replace

import numpy as np
import pytest

from app.errors import ImportFailed
from app.sources.recordings.battery_log import battery_log
from app.sources.recordings.import_mapping import ImportMapping
from app.sources.recordings.table import Table
from app.words import render

PROFILE = ImportMapping(time="t", current="I", voltages="V{n}")


def table(n=4, **columns):
    """Time in seconds, 10 A and two cells, and what a test adds or replaces."""
    plain = {"t": np.arange(n), "I": np.full(n, 10.0), "V1": np.full(n, 3.7), "V2": np.full(n, 3.8)}
    return Table("pack.csv", {name: np.asarray(v, dtype=float) for name, v in (plain | columns).items()})


def said(log):
    return [render(note) for note in log.notes]


def test_there_are_as_many_cells_as_columns():
    log = battery_log(table(), PROFILE)
    assert log.n_cells == 2
    np.testing.assert_array_equal(log.voltages_v[0, :2], [3.7, 3.8])
    assert log.voltages_v.shape == log.temperatures_degc.shape == (4, 2)
    assert np.isnan(log.temperatures_degc).all()
    assert (log.soc, log.notes) == (None, ())


@pytest.mark.parametrize(
    ("change", "columns", "field", "ours"),
    [
        ({}, {}, "current_a", 10.0),
        ({"charge_positive": True}, {}, "current_a", -10.0),
        ({"current_unit": "mA"}, {}, "current_a", 0.01),
        ({"voltage_unit": "mV"}, {"V": 3700.0}, "voltages_v", 3.7),
        ({"temperature_unit": "K"}, {"T": 298.15}, "temperatures_degc", 25.0),
        ({"soc": "S1", "soc_unit": "percent"}, {"S": 55.0}, "soc", 0.55),
        ({"soc": "S1", "soc_unit": "fraction"}, {"S": 0.55}, "soc", 0.55),
    ],
)
def test_units_and_sign_are_ours(change, columns, field, ours):
    given = {f"{name}{n}": np.full(4, value) for name, value in columns.items() for n in (1, 2)}
    profile = replace(PROFILE, temperatures="T{n}" if "T" in columns else "", **change)
    np.testing.assert_allclose(getattr(battery_log(table(**given), profile), field), ours)


@pytest.mark.parametrize("volts", [0.0, 0.5, 6.0, 6.5535, -1.0, float("nan")])
def test_a_voltage_that_no_cell_has_is_missing(volts):
    log = battery_log(table(V2=[3.8, volts, 3.8, 3.8]), PROFILE)
    assert np.flatnonzero(np.isnan(log.voltages_v[:, 1])).tolist() == [1]


@pytest.mark.parametrize(
    ("columns", "reason"),
    [
        ({"V1": np.full(4, 3700.0), "V2": np.full(4, 3800.0)}, r"voltage_unit = V: no cell voltage is within"),
        ({"t": [np.nan] * 4}, "no row contains a time"),
    ],
)
def test_a_wrong_unit_or_no_time_is_refused_by_name(columns, reason):
    with pytest.raises(ImportFailed, match=rf"pack\.csv: .*{reason}"):
        battery_log(table(**columns), PROFILE)


@pytest.mark.parametrize(
    ("sensors", "expected"),
    [
        (1, [20, 20, 20, 20]),
        (2, [20, 20, 21, 21]),
        (3, [20, 20, 21, 22]),
        (4, [20, 21, 22, 23]),
        (6, [20, 21, 22, 23]),
    ],
)
def test_sensors_are_spread_over_the_cells_in_order(sensors, expected):
    cells = {f"V{n}": np.full(4, 3.7) for n in range(1, 5)}
    temperatures = {f"T{n}": np.full(4, 19.0 + n) for n in range(1, sensors + 1)}
    log = battery_log(table(**cells, **temperatures), replace(PROFILE, temperatures="T{n}"))
    np.testing.assert_array_equal(log.temperatures_degc[0], expected)
    what = "the first 4 are used" if sensors > 4 else "each is used for the nearest cells"
    assert said(log) == ([] if sensors == 4 else [f"{sensors} temperatures for 4 cells: {what}"])


def test_time_begins_at_the_first_row_and_a_wall_clock_is_kept():
    started = 1_780_000_000.0
    log = battery_log(table(t=started + np.arange(4.0)), PROFILE)
    np.testing.assert_array_equal(log.time_s, [0, 1, 2, 3])
    assert log.started_unix_s == started
    log = battery_log(table(t=5.0 + np.arange(4.0)), PROFILE)
    assert (log.time_s[0], log.started_unix_s) == (0.0, None)


def test_without_a_time_rows_are_a_tenth_of_a_second_apart_and_that_is_said():
    log = battery_log(table(), ImportMapping(current="I", voltages="V{n}"))
    assert log.time_s == pytest.approx([0.0, 0.1, 0.2, 0.3])
    assert said(log) == ["no time column: rows 0.1 s apart assumed"]


def test_rows_out_of_order_are_sorted_with_all_their_values():
    log = battery_log(table(t=[0, 2, 1, 3], I=[0, 2, 1, 3], V1=[3.0, 3.2, 3.1, 3.3]), PROFILE)
    np.testing.assert_array_equal(log.current_a, [0, 1, 2, 3])
    np.testing.assert_array_equal(log.voltages_v[:, 0], [3.0, 3.1, 3.2, 3.3])
    assert said(log) == ["rows sorted by time"]


def test_rows_without_a_time_are_left_out_and_rows_of_one_time_stay():
    log = battery_log(table(t=[0, 1, 1, np.nan], I=[0, 1, 2, 3]), PROFILE)
    np.testing.assert_array_equal(log.current_a, [0, 1, 2])
    assert said(log) == [
        "1 of 4 rows have no time: left out",
        "1 rows have the time of the row before: kept, in their order",
    ]


def test_a_recording_may_take_weeks():
    assert battery_log(table(t=np.arange(4) * 30 * 86_400.0), PROFILE).time_s[-1] == 90 * 86_400


def test_a_time_of_unknown_unit_is_to_be_chosen():
    with pytest.raises(ImportFailed, match=r"t has no unit: choose it with `--set time_unit=s`"):
        battery_log(table(), replace(PROFILE, time_unit=""))


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"current": "amps"}, "current = 'amps': no such column"),
        ({"voltages": "Cell {n}"}, "voltages = 'Cell {n}': no column fits"),
        ({"time": "clock"}, "time = 'clock': no such column"),
        ({"soc": "S"}, "soc = 'S': no such column"),
        ({"temperatures": "T{n}"}, "temperatures = 'T{n}': no column fits"),
    ],
)
def test_a_column_that_is_missing_is_named_with_those_there_are(change, reason):
    with pytest.raises(ImportFailed) as refused:
        battery_log(table(), replace(PROFILE, **change))
    assert reason in str(refused.value)
    assert "'t', 'I', 'V1', 'V2'" in str(refused.value)


def test_chosen_cells_are_taken_with_their_temperatures():
    columns = {f"{kind}{n}": np.full(4, base + n) for kind, base in (("V", 3.0), ("T", 20.0)) for n in (1, 2, 3)}
    columns = {name: values * 0.5 if name[0] == "V" else values for name, values in columns.items()}
    given = replace(PROFILE, temperatures="T{n}", cells="3, 1-1")
    log = battery_log(table(**columns), given)
    assert log.n_cells == 2
    np.testing.assert_allclose(log.voltages_v[0], [2.0, 3.0])
    np.testing.assert_allclose(log.temperatures_degc[0], [21.0, 23.0])
    assert said(log) == ["2 of 3 cells used: 3, 1-1"]
    with pytest.raises(ImportFailed, match="no cell 4; 3 columns"):
        battery_log(table(**columns), replace(given, cells="2-4"))
