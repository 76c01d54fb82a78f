from pathlib import Path

import numpy as np
import pytest

from app.errors import ImportFailed
from app.sources.recordings.profile import ImportProfile, ProfileStore, guess, parse_profile, profile_text
from app.sources.recordings.table import Table

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
