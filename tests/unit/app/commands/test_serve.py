"""What the command line of `serve` means; that it serves, the integration tests show."""

import pytest

from app.cli import build_parser
from app.commands.serve import settings_from
from app.errors import ConfigError


def settings(tmp_path, *words):
    return settings_from(build_parser("serve").parse_args(["serve", "--data", str(tmp_path), *words]))


@pytest.mark.parametrize(
    ("words", "battery", "can", "also"),
    [
        ("", "team", None, None),
        ("--battery 2x6", "2x6", None, None),
        ("--battery front@slcan:A", "front", "slcan:A", None),
        ("--battery front@slcan:A --battery rear@slcan:B", "front", "slcan:A", "rear@slcan:B"),
        ("--battery front --can slcan:A --battery rear --battery top@slcan:C", "front", "slcan:A", "rear,top@slcan:C"),
        ("--battery front --battery rear --also top@slcan:C", "front", None, "rear,top@slcan:C"),
        ("--also top@slcan:C", "team", None, "top@slcan:C"),
    ],
)
def test_each_further_battery_stands_beside_the_first(words, battery, can, also, tmp_path):
    found = settings(tmp_path, *words.split())
    assert (found.battery, found.can, found.also) == (battery, can, also)


def test_a_bus_that_is_named_twice_is_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"can = slcan:B: not given beside --battery front@slcan:A"):
        settings(tmp_path, "--battery", "front@slcan:A", "--can", "slcan:B")


def test_a_battery_without_its_bus_is_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"can = : .*1 character"):
        settings(tmp_path, "--battery", "front@")
