import numpy as np
import pytest

from app.sources.recordings.quantities import (
    UNITS,
    candidates,
    find_unit,
    in_our_unit,
    is_unit,
    is_wall_clock,
    quantity_of,
    sounds_like,
    unit_of,
)


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


@pytest.mark.parametrize("name", ["", "#", "strain", "Voltage (kV)", "Pack Current (A)", "Cell 3 (mV)", "Cycle"])
def test_another_name_tells_none(name: str) -> None:
    assert quantity_of(name) is None


def test_a_longer_name_sounds_like_its_quantity() -> None:
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
