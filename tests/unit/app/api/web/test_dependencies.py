"""Each alias gives the part that its type says."""

import asyncio
from types import SimpleNamespace
from typing import Annotated, get_args, get_origin, get_type_hints

import pytest

from app.api.web import dependencies
from app.api.web.dependencies import FleetPart, SeasonSourcePart, SimulatorPart, WebParts
from app.api.web.problems import Problem
from app.service.master import MasterConfiguration
from app.service.service import Service

ASKED = (FleetPart, SeasonSourcePart, SimulatorPart)  # made or looked for at each request
ALIASES = {
    name: alias
    for name, alias in vars(dependencies).items()
    if name.endswith("Part") and get_origin(alias) is Annotated and alias not in ASKED
}
FIELDS = get_type_hints(Service) | get_type_hints(MasterConfiguration) | get_type_hints(WebParts)


class Named:
    """Gives the name of the attribute that it is asked for."""

    def __getattr__(self, name: str) -> object:
        return self if name in ("service", "configuration") else name


def connection(parts: object) -> SimpleNamespace:
    return SimpleNamespace(app=SimpleNamespace(state=SimpleNamespace(parts=parts)))


@pytest.mark.parametrize("alias", ALIASES)
def test_an_alias_gives_the_part_that_its_type_says(alias):
    part, depends = get_args(ALIASES[alias])
    assert FIELDS[asyncio.run(depends.dependency(connection(Named())))] == part


def test_no_two_aliases_give_the_same_part():
    given = [asyncio.run(get_args(alias)[1].dependency(connection(Named()))) for alias in ALIASES.values()]
    assert len(given) > 20
    assert len(set(given)) == len(given)


def test_without_a_simulated_car_there_is_none_to_ask():
    _, depends = get_args(SimulatorPart)
    with pytest.raises(Problem) as caught:
        asyncio.run(depends.dependency(connection(SimpleNamespace(simulator=None))))
    assert caught.value.status == 404
