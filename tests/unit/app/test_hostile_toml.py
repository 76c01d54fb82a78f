"""Every reader of a TOML file refuses what is beyond its limits by an error of its own that names the limit."""

import pytest

from app.analysis.expectations import Expectations
from app.battery.table_reader import ProfileError
from app.commands.season import cell_index
from app.errors import ConfigError, ImportFailed
from app.estimation.cell_model.cell_document import MOST_POINTS
from app.estimation.cell_model.cell_file import format_cell, load_cell, parse_cell
from app.estimation.errors import CellFileError
from app.sources.loaded_battery import battery_from_files, load_battery, team_battery
from app.sources.recordings.import_mapping import parse_mapping

HOSTILE = {
    "levels": "a = " + "[" * 100_000,
    "64 bits|18446744073709551615": "a = " + "9" * 60_000,
    "characters": "#" * 1_000_000,
    "TOML": "a = 2026-13-45",
}
BATTERY = '[battery]\nname = "a"\nsegments = [{segments}]\n{more}\n[source]\nkind = "master"\n'
READERS = {
    "battery": (lambda text: battery_from_files({"a.toml": text.encode()}), ProfileError),
    "cell": (parse_cell, CellFileError),
    "import profile": (parse_mapping, ImportFailed),
    "expectations": (lambda text: Expectations(text, team_battery().battery), ConfigError),
}


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("limit", HOSTILE)
def test_what_is_beyond_a_limit_is_named(reader, limit):
    read, error = READERS[reader]
    with pytest.raises(error, match=limit):
        read(HOSTILE[limit])


@pytest.mark.parametrize(
    ("segments", "more", "limit"),
    [
        ("999999999", "", "1..1000"),
        (",".join(["1000"] * 50_000), "", "1..1000"),
        ("1e308", "", "1..1000"),
        ("10", "[battery.limits]\ncell_voltage_max_v = 1e308", "0..10"),
        ("10", "[battery.temperatures]\nsensors = 999999999", "0..5000"),
        ("10", "bleed_ohm = nan", "0.01..10000"),
    ],
)
def test_a_battery_of_too_much_is_refused_with_the_bounds(segments, more, limit):
    with pytest.raises(ProfileError, match=limit):
        battery_from_files({"a.toml": BATTERY.format(segments=segments, more=more).encode()})


@pytest.mark.parametrize("zero", ["inf", "-inf", "nan"])
def test_a_number_of_a_profile_is_finite(zero):
    text = (
        f'[battery]\nname = "a"\nsegments = [2]\n[source]\ndbc = "b"\n[source.current]\nsignal = "c"\nzero = {zero}\n'
    )
    with pytest.raises(ProfileError, match=r"source\.current\.zero"):
        battery_from_files({"a.toml": text.encode()})


@pytest.mark.parametrize("shape", ["999999999x999999999", "1x601", "0x5", "999999999x1"])
def test_a_shape_beyond_what_a_bus_carries_is_refused(shape):
    with pytest.raises(ProfileError):
        load_battery(shape)


def test_a_table_over_many_points_is_refused_before_it_is_made():
    text = format_cell(load_cell())
    lines = [line for line in text.splitlines() if not line.startswith(("soc = ", "temperature_degc = "))]
    at = lines.index(next(line for line in lines if line.startswith("[circuit]")))
    many = ", ".join(str(k / 10_000) for k in range(10_000))
    head = [lines[at], f"soc = [{many}]", f"temperature_degc = [{many}]"]
    ocv = next(line for line in text.splitlines() if line.startswith("soc = "))
    lines = [*lines[:at], *head, *lines[at + 1 :]]
    lines.insert(lines.index("[ocv]") + 1, ocv)
    with pytest.raises(CellFileError, match=f"at most {MOST_POINTS} points"):
        parse_cell("\n".join(lines))


@pytest.mark.parametrize("place", ["9" * 60_000 + "/1", "²/1", "1/999999999", "1/1/1", ""])
def test_a_cell_that_no_battery_has_is_refused_on_the_command_line(place):
    with pytest.raises(ConfigError, match="1/1 to 8/12"):
        cell_index(team_battery().battery, place)


@pytest.mark.parametrize("place", ["9" * 60_000 + "/1", "999999999/999999999", "1/" + "9" * 5000])
def test_a_cell_that_no_battery_has_is_refused_by_the_expectation(place):
    battery = team_battery().battery
    with pytest.raises(ConfigError, match="1/1 to 8/12"):
        Expectations(f'[[alarm]]\nseverity = "trip"\ncell = "{place}"\n', battery)
    with pytest.raises(ConfigError, match="pack/cell"):
        Expectations(f'[[value]]\nname = "voltage_v[{place}]"\nmin = 1\n', battery)
