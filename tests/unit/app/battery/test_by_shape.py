"""A battery by its shape: what is made for the name, and what is no such name."""

import pytest

from app.battery.by_shape import MOST_CELLS, files_of_shape
from app.battery.table_reader import ProfileError
from app.sources.dbc.encoder import FrameEncoder
from app.sources.loaded_battery import load_battery


@pytest.mark.parametrize(("name", "segments"), [("1x1", (1,)), ("2x6", (6, 6)), ("1x13", (13,)), ("20x30", (30,) * 20)])
def test_every_value_of_every_cell_has_a_place_in_the_dbc_that_is_made(name, segments):
    loaded = load_battery(name)
    assert loaded.battery.segments == segments
    assert loaded.battery.n_sensors == sum(segments)
    speech = FrameEncoder(loaded.battery, loaded.dbc_mapping, loaded.definitions)
    assert not speech.lanes.troubles
    assert speech.not_encoded() == {}
    ids = [message.can_id for message in loaded.definitions.messages]
    assert len(ids) == len(set(ids))
    assert max(ids) < 0x800


@pytest.mark.parametrize("name", ["team", "2x6.toml", "-1x6", "x6", "2x", "2x6x1", "٢x6", "./2x6"])
def test_other_names_are_those_of_profiles(name):
    assert files_of_shape(name) is None


@pytest.mark.parametrize("name", ["25x25", "0x6", "6x0", "999999999x999999999"])
def test_a_shape_without_cells_or_with_more_than_a_bus_carries_is_refused_with_its_limit(name):
    with pytest.raises(ProfileError) as refused:
        load_battery(name)
    limit = f"packs x series cells per pack, such as 2x6, 1 to {MOST_CELLS} cells in total"
    assert str(refused.value) == f"battery = {name}: {limit}"


def test_a_missing_profile_is_named_once():
    with pytest.raises(ProfileError) as refused:
        load_battery("no-such-battery")
    assert str(refused.value).count("no-such-battery") == 1
