"""What `--also` names."""

import pytest

from app.errors import ConfigError
from app.sources.beside import beside
from app.sources.connections import Connections


def test_each_has_its_name_its_shape_and_its_bus() -> None:
    fox, orion = beside("team", "foxbms-2@virtual:a, orion-bms-2")
    assert (fox.slug, sum(fox.segments)) == ("foxbms-2-216-cells", 216)
    assert fox.connections == Connections(None, "virtual:a", "foxbms-2")
    assert orion.connections == Connections(None, None, "orion-bms-2")


@pytest.mark.parametrize(
    ("also", "why"),
    [
        ("orion-bms-2,orion-bms-2@virtual:a", "another name"),
        ("foxbms-2", "another name"),
        ("team", "with a DBC"),
        ("orion-bms-2@", "INTERFACE:CHANNEL"),
        ("orion-bms-2@nothing", "INTERFACE:CHANNEL"),
        ("no-such-profile@virtual:a", "no-such-profile"),
    ],
)
def test_what_cannot_be_served_is_refused_with_the_reason(also: str, why: str) -> None:
    with pytest.raises(ConfigError, match=why):
        beside("foxbms-2", also)


def test_without_it_there_is_one() -> None:
    assert beside("team", "") == []


@pytest.mark.parametrize("also", [" , orion-bms-2 ,, ", "orion-bms-2,"])
def test_empty_parts_and_spaces_between_batteries_do_not_matter(also: str) -> None:
    assert [each.connections.battery for each in beside("team", also)] == ["orion-bms-2"]


def test_a_bus_may_have_options_and_is_kept_as_it_was_named() -> None:
    url = "slcan:/dev/ttyACM0?bitrate=250000&timeout=0.05"
    (found,) = beside("team", f"orion-bms-2@{url}")
    assert found.connections.can == url
