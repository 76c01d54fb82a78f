"""A battery and its files: read from disk, and again from what was read."""

from pathlib import Path

import pytest

from app.battery.library import bundled_profiles
from app.battery.source import MemoryMap
from app.battery.table_reader import ProfileError
from app.sources.loaded_battery import battery_from_files, load_battery, team_battery

PARTS = ("ivt-s",)
DBC = 'VERSION ""\nBU_: A\nBO_ 256 {name}: 8 A\n SG_ {signal} : 0|16@1+ (0.001,0) [0|0] "V" A\n'
PROFILE = """
include = "ivt-s"
[battery]
name = "two cells"
segments = [2]
[source]
dbc = "own.dbc"
[[source.voltage]]
signal = "Cell_{cell}"
"""


@pytest.mark.parametrize("name", [name for name in bundled_profiles() if name not in PARTS])
def test_files_of_a_bundled_battery_give_it_again(name: str) -> None:
    loaded = load_battery(name)
    again = battery_from_files(loaded.files)
    assert again == loaded
    assert again.battery.n_cells == loaded.battery.n_cells


def test_team_speaks_by_its_master() -> None:
    assert isinstance(team_battery().source, MemoryMap)
    assert team_battery().dbc_mapping is None
    assert team_battery().battery.segments == (12,) * 8


def written(folder: Path, profile: str = PROFILE) -> Path:
    (folder / "own.dbc").write_text(DBC.format(name="Cells", signal="Cell_0"))
    path = folder / "car.toml"
    path.write_text(profile)
    return path


def test_what_a_profile_includes_is_among_its_files(tmp_path: Path) -> None:
    path = written(tmp_path)
    loaded = load_battery(str(path))
    assert list(loaded.files) == ["car.toml", "own.dbc", "ivt-s", "ivt-s.dbc"]
    assert {message.name for message in loaded.definitions.messages} >= {"Cells", "IVT_Result_I"}
    path.unlink()
    assert battery_from_files(loaded.files).source == loaded.source


def test_two_files_of_one_name_are_refused(tmp_path: Path) -> None:
    (tmp_path / "inner").mkdir()
    (tmp_path / "inner" / "part.toml").write_text('[source]\ndbc = "own.dbc"\n')
    (tmp_path / "inner" / "own.dbc").write_text(DBC.format(name="Other", signal="X"))
    path = written(tmp_path, PROFILE.replace("ivt-s", "inner/part.toml"))
    with pytest.raises(ProfileError, match=r"own\.dbc"):
        load_battery(str(path))


def test_a_missing_dbc_is_named(tmp_path: Path) -> None:
    path = written(tmp_path)
    (tmp_path / "own.dbc").unlink()
    with pytest.raises(ProfileError, match=r"source\.dbc.*own\.dbc"):
        load_battery(str(path))


def test_a_cell_file_beside_the_profile_is_found_from_anywhere(tmp_path: Path) -> None:
    profile = tmp_path / "p.toml"
    text = '[battery]\nname = "x"\nsegments = [4]\ncell = "mine.toml"\n[source]\nkind = "master"\n'
    profile.write_text(text, encoding="utf-8")
    assert load_battery(str(profile)).battery.cell == "mine.toml"  # nothing there: a bundled one of this name
    (tmp_path / "mine.toml").write_text("", encoding="utf-8")
    assert Path(load_battery(str(profile)).battery.cell) == tmp_path / "mine.toml"


@pytest.mark.parametrize(("longest", "is_fd"), [(8, False), (12, True), (64, True)])
def test_a_battery_uses_can_fd_where_a_message_is_longer_than_classic_can_allows(
    tmp_path: Path, longest: int, is_fd: bool
) -> None:
    dbc = f'VERSION ""\n\nBU_: A\n\nBO_ 1 M: {longest} A\n SG_ V1 : 0|16@1+ (0.001,0) [0|0] "V" A\n\n'
    (tmp_path / "x.dbc").write_text(dbc, encoding="utf-8")
    text = '[battery]\nname = "x"\nsegments = [1]\n[source]\ndbc = "x.dbc"\n[[source.voltage]]\nsignal = "V1"\n'
    (tmp_path / "p.toml").write_text(text, encoding="utf-8")
    assert load_battery(str(tmp_path / "p.toml")).uses_fd is is_fd
