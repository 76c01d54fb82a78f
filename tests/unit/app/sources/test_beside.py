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
