from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.errors import ImportFailed
from app.sources.recordings.profile import ImportProfile, ProfileStore, guess, parse_profile, profile_of, profile_text
from app.sources.recordings.table import Table
from tests.campaign import examples

ORION = ImportProfile(
    time="Time", current="Pack Current (A)", voltages="Cell {n} (mV)", voltage_unit="mV",
    temperatures="Thermistor {n} (C)", soc="Pack SOC (%)",
)  # fmt: skip


def table_of(columns: dict[str, float]) -> Table:
    return Table("x", {name: np.full(3, value) for name, value in columns.items()})


def test_the_profile_of_a_vehicle_log_is_guessed() -> None:
    cells = {f"Cell {n} (mV)": 3600.0 + n for n in range(1, 41)}
    sensors = {f"Thermistor {n} (C)": 25.0 for n in range(1, 11)}
    assert guess(table_of({"Time": 1.0, "Pack Current (A)": 5.0, "Pack SOC (%)": 80.0, **cells, **sensors})) == ORION


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


@pytest.mark.parametrize(("given", "missing"), [({"voltages": "V{n}"}, "current"), ({"current": "I"}, "voltages")])
def test_a_profile_that_names_too_little_says_what_is_missing(given: dict[str, str], missing: str) -> None:
    with pytest.raises(ImportFailed, match=f"{missing} is not named"):
        ImportProfile(**given).check_complete()


def test_a_profile_that_cannot_be_read_names_its_file(tmp_path: Path) -> None:
    (tmp_path / "bad.toml").write_text("speed = 3")
    with pytest.raises(ImportFailed, match=r"bad\.toml: speed: no such field"):
        ProfileStore(tmp_path).load("bad")


def test_profiles_are_kept_by_name(tmp_path):
    store = ProfileStore(tmp_path / "profiles")
    store.save("orion", ORION)
    assert store.names() == ["orion"]
    assert store.load("orion") == ORION == parse_profile(profile_text(ORION))
    for name in ("../up", "", "a/b"):
        with pytest.raises(ImportFailed, match="cannot be called"):
            store.save(name, ORION)
    with pytest.raises(ImportFailed, match="no such profile; there are: orion"):
        store.load("other")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("current = 3", "current = 3: a str"),
        ("wheels = 4", "wheels: no such field"),
        ("voltage_unit = 'kV'", "one of V, mV"),
        ("hold_s = -1", r"hold_s = -1: 0\.\.600"),
        ("[", "no TOML"),
    ],
)
def test_a_profile_that_is_wrong_names_the_field(text, reason):
    with pytest.raises(ImportFailed, match=reason):
        parse_profile(text)


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


@pytest.mark.parametrize("value", [True, "5", None, [5.0]])
def test_a_number_of_another_kind_is_refused_by_its_field(value: object) -> None:
    with pytest.raises(ImportFailed, match=r"max_rate_hz = .*float"):
        profile_of({"max_rate_hz": value})
    assert profile_of({"max_rate_hz": 5}).max_rate_hz == 5.0


@pytest.mark.parametrize(("field", "limit"), [("max_rate_hz", 1000.0), ("hold_s", 600.0)])
def test_the_limits_of_a_number_are_part_of_it_and_nan_is_beyond(field: str, limit: float) -> None:
    assert getattr(profile_of({field: limit}), field) == limit
    for value in (limit + 0.1, -0.1, float("nan"), float("inf")):
        with pytest.raises(ImportFailed, match=field):
            profile_of({field: value})


def test_names_that_toml_has_to_quote_come_back(tmp_path: Path) -> None:
    odd = ImportProfile(current='I "hall" \\ Ω\t[A]', voltages="Zelle {n}: ü")
    store = ProfileStore(tmp_path)
    store.save("odd", odd)
    assert store.load("odd") == odd
    assert ProfileStore(tmp_path / "none").names() == []


@settings(max_examples=examples(40))
@given(st.text(st.characters(exclude_categories=["Cs"]), max_size=12))
def test_any_name_of_a_column_is_read_back(name: str) -> None:
    profile = ImportProfile(current=name)
    assert parse_profile(profile_text(profile)) == profile
