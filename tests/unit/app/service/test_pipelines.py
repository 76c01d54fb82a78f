"""Pipelines come with the configured filter and cell, or with those that were chosen."""

import pytest

from app.errors import ConfigError
from app.estimation.cell_model.cell_file import bundled_cells, format_cell
from app.service.pipelines import Pipelines
from app.service.settings import Settings
from app.sources.loaded_battery import battery_from_files, team_battery


@pytest.fixture
def pipelines(tmp_path):
    return Pipelines(Settings(data=tmp_path, filter="coulomb", cell="samsung-25r-10p"))


def names(pipeline):
    return pipeline.filter_name, pipeline.cell_name


def test_without_a_choice_it_is_what_the_settings_say(pipelines):
    assert names(pipelines.new("serial")) == ("coulomb", "samsung-25r-10p")
    assert pipelines.cell.capacity_ah > 0


def test_a_filter_and_a_cell_can_be_chosen(pipelines):
    other = next(cell for cell in bundled_cells() if cell != "samsung-25r-10p")
    assert names(pipelines.new("replay", filter_name="ekf")) == ("ekf", "samsung-25r-10p")
    assert names(pipelines.new("replay", cell_name=other)) == ("coulomb", other)


def test_only_bundled_cells_and_the_services_own_can_be_chosen(pipelines, tmp_path):
    assert pipelines.cells[0] == "samsung-25r-10p"
    assert set(pipelines.cells) == set(bundled_cells())
    with pytest.raises(ConfigError, match="one of"):
        pipelines.new("replay", cell_name=str(tmp_path / "my-cell.toml"))


def test_imports_go_through_a_pipeline_of_their_own(pipelines):
    assert pipelines.for_import(team_battery()).source == "replay"
    assert pipelines.for_import(team_battery()) is not pipelines.for_import(team_battery())


def test_a_battery_from_elsewhere_names_no_cell_file_of_this_machine(pipelines, tmp_path):
    path = tmp_path / "cell.toml"
    path.write_text(format_cell(pipelines.cell))
    files = dict(team_battery().files)
    own = next(iter(files))
    files[own] = files[own].replace(b'"samsung-25r-10p"', f'"{path}"'.encode(), 1)
    assert battery_from_files(files).battery.cell == str(path)
    with pytest.raises(ConfigError, match="one of"):
        pipelines.for_import(battery_from_files(files))


def test_a_cell_that_is_none_stops_the_start(tmp_path):
    with pytest.raises(ConfigError, match="no-such-cell"):
        Pipelines(Settings(data=tmp_path, cell="no-such-cell"))
