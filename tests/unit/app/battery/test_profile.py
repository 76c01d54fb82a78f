import pytest

from app.battery.library import bundled_profiles, load_part, load_profile, profile_files
from app.battery.profile import read_document, understand
from app.battery.shape import TEAM
from app.battery.source import MemoryMap
from app.battery.table_reader import ProfileError

HEAD = '[battery]\nname = "x"\npacks = [3, 2]\n'
DBC = '[source]\ndbc = "x.dbc"\n'


def profile(text):
    def none(name):
        raise AssertionError(name)

    return understand(read_document(text, "x.toml", none))


def test_the_teams_profile_is_the_teams_shape():
    team = load_profile("team").profile
    assert team.battery.segments == (TEAM.cells_per_pack,) * TEAM.n_packs
    assert team.battery.n_sensors == TEAM.n_cells
    assert isinstance(team.source, MemoryMap)


@pytest.mark.parametrize("name", [name for name in bundled_profiles() if name != "ivt-s"])
def test_every_bundled_profile_can_be_loaded_with_its_files(name):
    loaded = load_profile(name)
    assert loaded.profile.battery.n_cells > 0
    assert all(file.is_file() for file in loaded.dbc_files)


def test_the_current_sensor_is_a_part_and_no_battery():
    assert load_part("ivt-s").values["source"]["current"]["signal"]
    with pytest.raises(ProfileError, match="battery"):
        load_profile("ivt-s")


def test_packs_may_differ_and_cells_count_through_them():
    battery = profile(HEAD + DBC).battery
    assert battery.n_cells == 5
    assert [battery.place(cell) for cell in range(5)] == [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1)]
    with pytest.raises(IndexError):
        battery.place(5)


def test_a_profile_that_says_segments_is_still_read():
    sensors = "[battery.temperatures]\nsensors = 2\ncells = 'pack'\n"
    former = HEAD.replace("packs", "segments")
    assert profile(former + sensors.replace("pack", "segment") + DBC).battery == profile(HEAD + sensors + DBC).battery
    with pytest.raises(ProfileError) as wrong:
        profile(former.replace("3", "0") + DBC)
    assert wrong.value.line == 3
    with pytest.raises(ProfileError, match="segments"):
        profile(HEAD + "segments = [3, 2]\n" + DBC)


@pytest.mark.parametrize(
    ("text", "line", "field", "limit"),
    [
        ('[battery]\nname = "x"\npacks = [3, 0]\n' + DBC, 3, "battery.packs", "1..1000"),
        ('[battery]\nname = "x"\n' + DBC, 1, "battery.packs", "missing"),
        (HEAD + "paralel = 2\n" + DBC, 4, "battery.paralel", "parallel"),
        (HEAD + "[battery.drawing]\norder = [1, 1]\n" + DBC, 5, "battery.drawing.order", "each pack"),
        (HEAD + "[battery.temperatures]\nsensors = 3\ncells = 'pack'\n" + DBC, 5, "sensors", "multiple"),
        (HEAD + "[battery.temperatures]\ncells = [[1], [6]]\n" + DBC, 5, "cells", "1..5"),
        (HEAD + "[battery.limits]\ncell_voltage_max_v = 42\n" + DBC, 5, "cell_voltage_max_v", "0..10"),
        (
            HEAD + DBC + "[[source.voltage]]\nsignal = 'a'\n\n[[source.voltage]]\nsignal = 3\n",
            10,
            "source.voltage[1].signal",
            "text",
        ),
        (HEAD + DBC + "[[source.voltage]]\nsignal = 'a'\nunit = 'kV'\n", 8, "source.voltage[0].unit", "mV"),
        (HEAD + DBC + "[source.current]\nsignal = 'a'\npositive = 'up'\n", 8, "source.current.positive", "charge"),
        (HEAD + DBC + "[[source.voltage]]\nsignal = 'a'\nnumbers = {cel = 'b'}\n", 8, "numbers.cel", "cell"),
        ("[battery\n", 1, "TOML", ""),
    ],
)
def test_what_is_wrong_is_told_by_line_field_and_limit(text, line, field, limit):
    with pytest.raises(ProfileError) as error:
        profile(text)
    assert error.value.line == line
    assert field in str(error.value)
    assert limit in str(error.value)
    assert str(error.value).startswith(f"x.toml:{line}: ")


def test_what_a_profile_includes_counts_where_it_says_nothing_itself(tmp_path):
    own = tmp_path / "own.toml"
    own.write_text('include = ["ivt-s"]\n' + HEAD + DBC + '[source.current]\nsignal = "Mine"\n')
    loaded = load_profile(str(own))
    assert str(loaded.profile.source.current.signal) == "Mine"
    assert str(loaded.profile.source.pack_voltage.signal) == "IVT_Result_U1.IVT_Voltage_1"
    assert [file.name for file in loaded.dbc_files] == ["x.dbc", "ivt-s.dbc"]
    assert loaded.dbc_files[0] == tmp_path / "x.dbc"


def test_a_profile_that_includes_itself_is_refused(tmp_path):
    own = tmp_path / "own.toml"
    own.write_text('include = ["own.toml"]\n' + HEAD + DBC)
    with pytest.raises(ProfileError, match="in a loop"):
        load_profile(str(own))


def test_a_missing_profile_names_those_that_there_are():
    with pytest.raises(ProfileError, match="foxbms-2"):
        load_profile("nothing.toml")


@pytest.mark.parametrize("table", ['[[witness]]\nname = "second"\n', "[witness]\n"])
@pytest.mark.parametrize("load", [load_profile, profile_files])
def test_a_withdrawn_table_is_refused_by_its_line_and_with_what_to_do(tmp_path, table, load):
    (tmp_path / "base.toml").write_text(f'include = ["foxbms-2"]\n{table}')
    with pytest.raises(ProfileError, match=r"base\.toml:2: witness = .*no longer supported: .*second service"):
        load(str(tmp_path / "base.toml"))
    (tmp_path / "mine.toml").write_text('include = ["base.toml"]\n')
    with pytest.raises(ProfileError, match=r"witness = .*no longer supported"):
        load(str(tmp_path / "mine.toml"))
