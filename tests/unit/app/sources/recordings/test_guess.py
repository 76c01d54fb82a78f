"""A table's profile out of its names and numbers."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.sources.recordings.guess import guess, with_units
from app.sources.recordings.import_mapping import ImportMapping
from app.sources.recordings.table import Table
from tests.campaign import examples


def table_of(columns: dict[str, float]) -> Table:
    return Table("x", {name: np.full(3, value) for name, value in columns.items()})


NAN = float("nan")
EXPORT = ["time_s", "elapsed_s", "uptime_s", "i_fc (A)", "v[0] (V)", "v[1] (V)", "t[0] (degC)", "soc"]


@pytest.mark.parametrize(
    ("columns", "expected"),
    [
        (
            {"Time": 1.0, "Pack Current (A)": 5.0, "Pack SOC (%)": 80.0}
            | {f"Cell {n} (mV)": 3600.0 + n for n in range(1, 41)}
            | {f"Thermistor {n} (C)": 25.0 for n in range(1, 11)},
            {"time": "Time", "current": "Pack Current (A)", "voltages": "Cell {n} (mV)", "voltage_unit": "mV",
             "temperatures": "Thermistor {n} (C)", "soc": "Pack SOC (%)"},
        ),
        (
            {"t [ms]": 1.0, "I_batt": 1.0} | {f"Pack{p}_Cell{n}_V": 3.7 for p in (1, 2) for n in (1, 2, 10)},
            {"time": "t [ms]", "time_unit": "ms", "current": "I_batt", "voltages": "Pack{p}_Cell{n}_V"},
        ),
        (
            {"Zeit [min]": 1.0, "Strom [mA]": 5.0, "U1": 3.7, "U2": 3.7, "soc": 0.5},
            {"time": "Zeit [min]", "time_unit": "min", "current": "Strom [mA]", "current_unit": "mA",
             "voltages": "U{n}", "soc": "soc", "soc_unit": "fraction"},
        ),
        *(  # units by the numbers
            ({"Cell 1": median, "Cell 2": median}, {"voltages": "Cell {n}", "voltage_unit": unit})
            for median, unit in ((3.7, "V"), (3700.0, "mV"), (37000.0, "0.1mV"))
        ),
        ({"Temp 1": 298.0, "Temp 2": 299.0}, {"temperatures": "Temp {n}", "temperature_unit": "K"}),
        # numbers that all names share belong to the name
        (
            {f"Cell {n} (0.1mV)": 37000.0 for n in (1, 2, 10)},
            {"voltages": "Cell {n} (0.1mV)", "voltage_unit": "0.1mV"},
        ),
        (
            {f"BMS2 Pack{p} Cell{n} V": 3.7 for p in (1, 2) for n in (1, 2, 3)},
            {"voltages": "BMS2 Pack{p} Cell{n} V"},
        ),
        # what is not clear is for a person to name
        ({f"Row{r}_Pack{p}_Cell{n}_V": 3.7 for r in (1, 2) for p in (1, 2) for n in (1, 2)}, {}),
        ({"a": 1.0, "b": 2.0}, {}),
        ({"Cell 1 V": NAN, "Cell 2 V": NAN}, {}),
        ({}, {}),
        # what we export is known by its first columns
        (
            dict.fromkeys(EXPORT, 1.0),
            {"time": "time_s", "current": "i_fc (A)", "voltages": "v[{n}] (V)", "temperatures": "t[{n}] (degC)",
             "soc": "soc", "soc_unit": "fraction"},
        ),
    ],
)  # fmt: skip
def test_the_profile_of_a_table_is_guessed(columns: dict[str, float], expected: dict[str, str]) -> None:
    assert guess(table_of(columns)) == ImportMapping(**expected)


def test_an_export_has_no_current_where_it_has_none_and_its_finer_time() -> None:
    assert guess(table_of(dict.fromkeys(EXPORT[:3], 1.0))).current == ""
    assert guess(table_of(dict.fromkeys([*EXPORT, "time"], 1.0))).time == "time"  # to the microsecond


@settings(max_examples=examples(25))
@given(
    st.lists(st.tuples(st.integers(0, 20), st.integers(0, 20)), min_size=2, max_size=12, unique=True),
    st.sampled_from(["Pack{}_Cell{}_V", "Cell {1}.{0} Volt", "V{}-{} (0.1mV)", "Cell{1} 12s{0} 3p V"]),
)
def test_a_guessed_pattern_finds_every_column_that_it_was_made_of(numbers: list[tuple[int, int]], name: str) -> None:
    columns = {name.format(*each): 3.7 for each in numbers}
    table = table_of(columns)
    assert table.matrix("voltages", guess(table).voltages).shape == (3, len(columns))


DAY_S = 86_400.0


@pytest.mark.parametrize(
    ("values", "unit"),
    [
        ([0.0, 0.1, 3600.0], "s"),
        ([0.0, 0.5, 30 * DAY_S], "s"),
        ([0.0, 2000.0, 4000.0], ""),  # rows of 2 s in ms, or of half an hour
        ([1.78e9, 1.78e9 + 10], "s"),
        ([1.78e12, 1.78e12 + 10], "ms"),
        ([1.78e15, 1.78e15 + 10], "us"),
        ([float("nan")], "s"),
    ],
)
def test_the_unit_of_time_is_named_where_it_is_clear(values: list[float], unit: str) -> None:
    table = Table("x", {"at": np.array(values)})
    assert with_units(ImportMapping(time="at"), table, ["time"]).time_unit == unit


def test_units_are_picked_for_the_quantities_that_are_asked_for() -> None:
    table = table_of({"i": 12_000.0, "soc": 0.4, "a1": 3700.0, "a2": 3650.0, "b": 300.0})
    given = ImportMapping(current="i", soc="2", voltages="a{n}", temperatures="b")
    found = with_units(given, table, ["current", "soc", "voltage", "temperature", "time"])
    assert (found.current_unit, found.soc_unit) == ("mA", "fraction")
    assert (found.voltage_unit, found.temperature_unit) == ("mV", "K")
    assert with_units(given, table, []) == given
    nowhere = ImportMapping(current="none", voltages="none{n}")
    assert with_units(nowhere, table, ["current", "voltage"]) == nowhere
