"""Pipelines have the filter and the cell of their factory, or those that were chosen."""

import pytest

from app.errors import ConfigError
from app.estimation.cell_model.cell_file import bundled_cells, format_cell
from app.live.pipeline_factory import PipelineFactory
from app.sources.loaded_battery import battery_from_files, team_battery


@pytest.fixture
def factory():
    return PipelineFactory("coulomb", "samsung-25r-10p")


def names(pipeline):
    return pipeline.filter_name, pipeline.cell_name


@pytest.mark.parametrize(("names", "field"), [(("kalman", "lco-pouch"), "filter"), (("fused", "lead-acid"), "cell")])
def test_a_name_that_stands_for_nothing_is_named(names, field):
    with pytest.raises(ConfigError) as caught:
        PipelineFactory(*names)
    assert caught.value.field == field


def test_its_pipelines_say_what_estimates_and_share_nothing(master):
    chain = PipelineFactory("coulomb", "samsung-25r-10p")
    one, other = chain.pipeline("serial", "port"), chain.pipeline("replay", "recorded")
    snapshot = one.feed(master.frame()).snapshot
    assert (snapshot.estimator.filter, snapshot.estimator.cell) == ("coulomb", "samsung-25r-10p")
    assert one.estimates is not None
    assert other.estimates is None


def test_a_filter_and_a_cell_can_be_chosen(factory):
    other = next(cell for cell in bundled_cells() if cell != "samsung-25r-10p")
    assert names(factory.chosen("ekf").pipeline("replay")) == ("ekf", "samsung-25r-10p")
    assert names(factory.chosen(cell_name=other).pipeline("replay")) == ("coulomb", other)


def test_only_bundled_cells_and_the_services_own_can_be_chosen(factory, tmp_path):
    assert factory.cells[0] == "samsung-25r-10p"
    assert set(factory.cells) == set(bundled_cells())
    with pytest.raises(ConfigError, match="one of"):
        factory.chosen(cell_name=str(tmp_path / "my-cell.toml"))


def test_imports_go_through_a_pipeline_of_their_own(factory):
    assert factory.for_import(team_battery()).source == "replay"
    assert factory.for_import(team_battery()) is not factory.for_import(team_battery())


def test_a_battery_from_elsewhere_names_no_cell_file_of_this_machine(factory, tmp_path):
    path = tmp_path / "cell.toml"
    path.write_text(format_cell(factory.cell))
    files = dict(team_battery().files)
    own = next(iter(files))
    files[own] = files[own].replace(b'"samsung-25r-10p"', f'"{path}"'.encode(), 1)
    assert battery_from_files(files).battery.cell == str(path)
    with pytest.raises(ConfigError, match="one of"):
        factory.for_import(battery_from_files(files))
