"""A table's profile out of its names and numbers."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.sources.recordings.guess import guess, with_units
from app.sources.recordings.profile import ImportProfile
from app.sources.recordings.table import Table
from tests.campaign import examples


def table_of(columns: dict[str, float]) -> Table:
    return Table("x", {name: np.full(3, value) for name, value in columns.items()})


def test_the_profile_of_a_vehicle_log_is_guessed() -> None:
    cells = {f"Cell {n} (mV)": 3600.0 + n for n in range(1, 41)}
    sensors = {f"Thermistor {n} (C)": 25.0 for n in range(1, 11)}
    found = guess(table_of({"Time": 1.0, "Pack Current (A)": 5.0, "Pack SOC (%)": 80.0, **cells, **sensors}))
    assert found == ImportProfile(
        time="Time", current="Pack Current (A)", voltages="Cell {n} (mV)", voltage_unit="mV",
        temperatures="Thermistor {n} (C)", soc="Pack SOC (%)",
    )  # fmt: skip


def test_packs_and_units_are_guessed() -> None:
    packs = {f"Pack{p}_Cell{n}_V": 3.7 for p in (1, 2) for n in (1, 2, 10)}
    found = guess(table_of({"t [ms]": 1.0, "I_batt": 1.0, **packs}))
    assert (found.time, found.time_unit) == ("t [ms]", "ms")
    assert (found.current, found.voltages) == ("I_batt", "Pack{p}_Cell{n}_V")


def test_names_of_test_rigs_are_guessed_too() -> None:
    found = guess(table_of({"Zeit [min]": 1.0, "Strom [mA]": 5.0, "U1": 3.7, "U2": 3.7, "soc": 0.5}))
    assert (found.time, found.time_unit, found.current, found.current_unit) == ("Zeit [min]", "min", "Strom [mA]", "mA")
    assert (found.voltages, found.soc, found.soc_unit) == ("U{n}", "soc", "fraction")


@pytest.mark.parametrize(("median", "unit"), [(3.7, "V"), (3700.0, "mV"), (37000.0, "0.1mV")])
def test_the_unit_of_voltages_is_told_by_their_numbers(median: float, unit: str) -> None:
    assert guess(table_of({"Cell 1": median, "Cell 2": median})).voltage_unit == unit


def test_temperatures_in_kelvin_are_told_by_their_numbers() -> None:
    assert guess(table_of({"Temp 1": 298.0, "Temp 2": 299.0})).temperature_unit == "K"


def test_what_is_not_clear_is_left_empty() -> None:
    assert guess(table_of({"a": 1.0, "b": 2.0})) == ImportProfile()


def test_numbers_that_all_names_share_belong_to_the_name() -> None:
    columns = {f"Cell {n} (0.1mV)": 37000.0 for n in (1, 2, 10)}
    table = table_of({"Time": 0.0, "Current": 1.0, **columns})
    found = guess(table)
    assert (found.voltages, found.voltage_unit) == ("Cell {n} (0.1mV)", "0.1mV")
    assert table.matrix("voltages", found.voltages).shape == (3, 3)


def test_of_three_numbers_two_may_differ_and_are_pack_and_cell() -> None:
    columns = {f"BMS2 Pack{p} Cell{n} V": 3.7 for p in (1, 2) for n in (1, 2, 3)}
    assert guess(table_of(columns)).voltages == "BMS2 Pack{p} Cell{n} V"


def test_names_with_three_numbers_that_differ_are_for_a_person_to_name() -> None:
    columns = {f"Row{r}_Pack{p}_Cell{n}_V": 3.7 for r in (1, 2) for p in (1, 2) for n in (1, 2)}
    assert guess(table_of(columns)).voltages == ""


@settings(max_examples=examples(25))
@given(
    st.lists(st.tuples(st.integers(0, 20), st.integers(0, 20)), min_size=2, max_size=12, unique=True),
    st.sampled_from(["Pack{}_Cell{}_V", "Cell {1}.{0} Volt", "V{}-{} (0.1mV)", "Cell{1} 12s{0} 3p V"]),
)
def test_a_guessed_pattern_finds_every_column_that_it_was_made_of(numbers: list[tuple[int, int]], name: str) -> None:
    columns = {name.format(*each): 3.7 for each in numbers}
    table = table_of(columns)
    assert table.matrix("voltages", guess(table).voltages).shape == (3, len(columns))


def test_columns_without_a_number_in_them_or_a_value_are_nothing() -> None:
    assert guess(table_of({"Cell 1 V": float("nan"), "Cell 2 V": float("nan")})).voltages == ""
    assert guess(Table("x", {})) == ImportProfile()


def test_what_we_export_is_known_by_its_first_columns() -> None:
    names = ["time_s", "elapsed_s", "uptime_s", "i_fc (A)", "v[0] (V)", "v[1] (V)", "t[0] (degC)", "soc"]
    found = guess(table_of(dict.fromkeys(names, 1.0)))
    assert (found.time, found.current, found.voltages) == ("time_s", "i_fc (A)", "v[{n}] (V)")
    assert (found.temperatures, found.soc, found.soc_unit) == ("t[{n}] (degC)", "soc", "fraction")
    assert guess(table_of(dict.fromkeys(names[:3], 1.0))).current == ""
    assert guess(table_of(dict.fromkeys([*names, "time"], 1.0))).time == "time"  # to the microsecond


DAY_S = 86_400.0


@pytest.mark.parametrize(
    ("values", "unit"),
    [
        ([0.0, 0.1, 3600.0], "s"),
        ([0.0, 6.9 * DAY_S], "s"),
        ([0.0, 7.1 * DAY_S], "ms"),  # no recording is so long
        ([1.78e9, 1.78e9 + 10], "s"),
        ([1.78e12, 1.78e12 + 10], "ms"),
        ([1.78e15, 1.78e15 + 10], "us"),
        ([float("nan")], "s"),
    ],
)
def test_the_unit_of_time_is_the_coarsest_that_can_be(values: list[float], unit: str) -> None:
    table = Table("x", {"at": np.array(values)})
    assert with_units(ImportProfile(time="at"), table, ["time"]).time_unit == unit


def test_units_are_picked_for_the_quantities_that_are_asked_for() -> None:
    table = table_of({"i": 12_000.0, "soc": 0.4, "a1": 3700.0, "a2": 3650.0, "b": 300.0})
    given = ImportProfile(current="i", soc="2", voltages="a{n}", temperatures="b")
    found = with_units(given, table, ["current", "soc", "voltage", "temperature", "time"])
    assert (found.current_unit, found.soc_unit) == ("mA", "fraction")
    assert (found.voltage_unit, found.temperature_unit) == ("mV", "K")
    assert with_units(given, table, []) == given
    nowhere = ImportProfile(current="none", voltages="none{n}")
    assert with_units(nowhere, table, ["current", "voltage"]) == nowhere
