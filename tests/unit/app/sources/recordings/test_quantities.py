"""Quantities and units by the names and numbers of columns; the sign of a current by its state and voltage."""

import numpy as np
import pytest

from app.sources.recordings.battery_log import battery_log
from app.sources.recordings.dataset import load_recording
from app.sources.recordings.guess import guess
from app.sources.recordings.quantities import (
    UNITS,
    candidates,
    charges_positive,
    find_unit,
    flows_both_ways_unsigned,
    in_our_unit,
    is_unit,
    is_wall_clock,
    quantity_of,
    signed,
    sounds_like,
    state_of,
    states_direction,
    unit_of,
)
from app.sources.recordings.table import load_table


@pytest.mark.parametrize(
    ("name", "quantity", "unit"),
    [
        ("time_s", "time", "s"),
        ("Test Time (hh:mm:ss)", "time", "s"),
        ("t [ms]", "time", "ms"),
        ("Zeit", "time", None),
        ("I/mA", "current", "mA"),
        ("<I>/A", "current", "A"),
        ("Strom [A]", "current", "A"),
        ("Cell_Voltage_V", "voltage", "V"),
        ("U_cell [mV]", "voltage", "mV"),
        ("Ewe/V", "voltage", "V"),
        ("T", "temperature", None),
        ("Temp (°C)", "temperature", "degC"),
        ("temperature [K]", "temperature", "K"),
        ("Surface Temp (F)", "temperature", "degF"),
        ("State of Charge (%)", "soc", "percent"),
        ("soc", "soc", None),
        ("Voltage #4", "voltage", None),
        ("总时间", "time", None),
        ("电流(A)", "current", "A"),
        ("电压(mV)", "voltage", "mV"),
        ("温度(℃)", "temperature", "degC"),
    ],
)
def test_a_whole_name_tells_quantity_and_unit(name: str, quantity: str, unit: str | None) -> None:
    assert (quantity_of(name), unit_of(name, quantity)) == (quantity, unit)


def test_a_longer_name_tells_none_but_sounds_like_its_quantity() -> None:
    names = ("", "#", "strain", "Voltage (kV)", "Pack Current (A)", "Cell 3 (mV)", "Cycle")
    assert {name: quantity_of(name) for name in names} == dict.fromkeys(names)
    assert sounds_like("Pack Current (A)", "current")
    assert sounds_like("Cell 3 (mV)", "voltage")
    assert sounds_like("Thermistor 1 (C)", "temperature")
    assert not sounds_like("Sample", "current")
    assert not sounds_like("Strain", "voltage")


def best(quantity: str, **columns: list[float]) -> str:
    found = candidates(quantity, {name.replace("__", " "): np.array(values) for name, values in columns.items()})
    return found[0].name if found else ""


def test_the_plain_name_goes_before_one_that_sounds_alike_and_a_unit_before_none() -> None:
    flat = {"Pack Current (A)": [1.0], "I": [1.0], "Time (s)": [1.0], "Test": [1.0], "x": [1.0]}
    assert best("current", **flat) == "I"
    assert best("time", **flat) == "Time (s)"
    assert best("soc", **flat) == ""


def test_a_name_with_other_words_in_it_is_another_quantity() -> None:
    assert best("current", date_stamp=[1, 2, 3], amp_hours=[0, 1, 2], Amps=[1, 1, 1]) == "Amps"
    assert best("current", **{"Amp-hr": [0, 1, 2], "Watt-hr": [0, 1, 2]}) == ""
    assert best("time", **{"T/R": [0, 1, 2]}) == best("temperature", **{"T/R": [20, 21, 22]}) == ""
    assert best("voltage", **{"Cell 1 Internal Resistance": [3.7], "Cell 1 Open Voltage": [3.7]}) == ""
    assert best("current", current_motor=[1, 2], d_axis_current=[1, 2], current_in=[1, 2]) == "current_in"


def test_numbers_decide_between_names() -> None:
    dates = [1.5e9, 1.5e9, 1.5e9 + 1]
    assert best("time", Date_Time=dates, Test_Time=[0.0, 0.5, 1.0]) == "Test_Time"
    assert best("time", Date_Time=[1.5e9, 1.5e9 + 1, 1.5e9 + 2], Time=[0, 1, 0]) == "Date_Time"  # begins again
    assert best("temperature", Temp=[-2501.0], Surface_Temp=[21.0]) == "Surface_Temp"
    assert best("voltage", Voltage=[np.nan], Volts=[3.7]) == "Volts"


@pytest.mark.parametrize(
    ("quantity", "unit", "value", "ours"),
    [
        ("time", "h", 2.0, 7200.0),
        ("time", "us", 5e6, 5.0),
        ("current", "0.1A", 25.0, 2.5),
        ("voltage", "0.1mV", 36000.0, 3.6),
        ("temperature", "K", 298.15, 25.0),
        ("temperature", "degF", 77.0, 25.0),
        ("temperature", "0.1degC", 250.0, 25.0),
        ("soc", "percent", 80.0, 0.8),
        ("soc", "fraction", 0.8, 0.8),
    ],
)
def test_a_unit_is_converted_into_ours(quantity: str, unit: str, value: float, ours: float) -> None:
    assert in_our_unit(np.array([value, np.nan]), quantity, unit) == pytest.approx([ours, np.nan], nan_ok=True)


def test_units_are_found_however_they_are_written() -> None:
    assert [find_unit("time", text) for text in ("Sec", "HR", "ms", "A")] == ["s", "h", "ms", None]
    assert [find_unit("soc", text) for text in ("%", "Pct", "1")] == ["percent", "percent", "fraction"]
    assert is_unit("mV")
    assert not is_unit("kV")
    for quantity, units in UNITS.items():
        assert all(find_unit(quantity, unit) == unit for unit in units)


def test_a_date_with_its_time_is_a_wall_clock() -> None:
    assert is_wall_clock("Date_and_Time")
    assert not is_wall_clock("Test Time")


def test_the_voltage_of_a_full_cell_goes_before_that_of_its_electrodes() -> None:
    volts = {"Ewe/V": [3.9, 3.8], "Ece/V": [0.1, 0.1], "Ewe-Ece/V": [3.8, 3.7]}
    assert best("voltage", **volts) == "Ewe-Ece/V"
    assert best("voltage", **{"Ewe/V": [3.9, 3.8], "Ecell/V": [3.8, 3.7]}) == "Ecell/V"


def test_a_date_without_its_time_of_the_day_is_no_time() -> None:
    days = [1.5e9, 1.5e9, 1.5e9 + 86_400]
    assert best("time", Date=days, Time=[86_398.0, 86_399.0, 0.0]) == "Time"
    assert best("time", Date=[1.5e9, 1.5e9 + 1, 1.5e9 + 2]) == "Date"


MACCOR = "Rec#\tTestTime\tAmps\tVolts\tState\n" + "".join(
    f"{k}\t{k}.0\t{1.0 if state in 'CD' else 0.0}\t{3.7 + 0.05 * ((state == 'C') - (state == 'D'))}\t{state}\n"
    for k, state in enumerate("RDDDRCCCR", 1)
)


@pytest.mark.parametrize(
    ("words", "sign"),
    [
        (["D", "DCH", "Dchg", "CC DChg", "CC_DChg", "恒流放电", "Discharge", "discharging"], -1.0),
        (["C", "CHA", "CC Chg", "CCCV_Chg", "恒流恒压充电", "Charge", "charging"], 1.0),
        (["R", "PAU", "Rest", "Idle", "Pause", "S", "", "CV"], 0.0),
    ],
)
def test_words_for_charge_and_discharge(words: list[str], sign: float) -> None:
    assert {word: state_of(word) for word in words} == dict.fromkeys(words, sign)


def test_a_current_without_a_sign_gets_that_of_its_state(tmp_path) -> None:
    path = tmp_path / "maccor.txt"
    path.write_text(MACCOR)
    table = load_table(path)
    expected = [0, 1, 1, 1, 0, -1, -1, -1, 0]
    np.testing.assert_array_equal(battery_log(table, guess(table)).current_a, expected)
    for charge_positive in (False, True):
        recording = load_recording(path, charge_positive=charge_positive)
        np.testing.assert_array_equal(recording.current_a, expected)
        assert any("State gives" in note for note in recording.notes)


def test_a_current_with_a_sign_keeps_it() -> None:
    current, state = np.array([1.0, -1.0]), np.array([1.0, -1.0])
    assert signed(current, {"State": state}) == (pytest.approx(current), None)
    assert signed(np.abs(current), {"Other": state})[1] is None
    assert states_direction("Step Type")
    assert states_direction("工步类型")
    assert not states_direction("Estate")


@pytest.mark.parametrize("turn", [1.0, -1.0])
def test_the_sign_is_told_by_steps_and_by_the_course_of_a_slow_test(turn) -> None:
    rng = np.random.default_rng(3)
    steps = np.tile(np.repeat([0.0, 2.0, -1.0], 20), 4)
    assert charges_positive(turn * steps, 3.7 + 0.02 * steps) == (turn > 0)
    slow = np.full(5000, -0.05)  # a meter of 1 mV that moves once in ten rows
    falling = np.round(np.linspace(4.1, 3.6, 5000) + rng.normal(0, 0.0005, 5000), 3)
    assert charges_positive(turn * slow, falling) == (turn > 0)


def test_nothing_is_turned_by_rows_that_tell_nothing() -> None:
    assert not charges_positive(np.zeros(9), np.linspace(3.6, 3.7, 9))
    assert not charges_positive(np.full(9, 1.0), np.full(9, np.nan))
    assert not charges_positive(np.array([1.0]), np.array([3.7]))
    assert not charges_positive(np.ones(5000), 3.7 + np.random.default_rng(1).normal(0, 0.01, 5000))


def test_the_estimator_turns_a_file_that_counts_charging_as_positive_and_says_so(tmp_path) -> None:
    path = tmp_path / "arbin.csv"
    path.write_text(
        "Test_Time(s),Current(A),Voltage(V)\n" + "".join(f"{k},-1.5,{4.1 - 0.002 * k:.3f}\n" for k in range(100))
    )
    for charge_positive in (False, True):
        recording = load_recording(path, charge_positive=charge_positive)
        assert set(recording.current_a) == {1.5}
        assert any("positive on charge: sign turned" in note for note in recording.notes)


def drive(currents, sign):
    """Voltage of a cell under blocks of current: 50 mV a volt lower on discharge, positive on charge by `sign`."""
    flows = np.repeat(currents, 5)
    return np.abs(flows), 3.7 + 0.01 * np.repeat(sign, 5) * np.abs(flows)


def test_a_current_without_a_sign_that_flows_both_ways_turns_nothing():
    current, voltage = drive([0, 8, 0, 10, 0, 9, 0, 8, 0], [0, 1, 0, 1, 0, -1, 0, -1, 0])
    assert flows_both_ways_unsigned(current, voltage)
    assert not charges_positive(current, voltage)


def test_a_current_without_a_sign_that_only_charges_is_positive_on_charge():
    current, voltage = drive([0, 8, 0, 10, 0, 9, 0], [0, 1, 0, 1, 0, 1, 0])
    assert not flows_both_ways_unsigned(current, voltage)
    assert charges_positive(current, voltage)
