"""What the command line of `serve` means; that it serves, the integration tests show."""

import pytest

from app.cli import build_parser
from app.commands.serve import settings_from
from app.errors import ConfigError


def settings(tmp_path, *words):
    return settings_from(build_parser("serve").parse_args(["serve", "--data", str(tmp_path), *words]))


@pytest.mark.parametrize(
    ("words", "battery", "can"),
    [
        ("", "team", None),
        ("--battery 2x6", "2x6", None),
        ("--battery front --can slcan:A", "front", "slcan:A"),
    ],
)
def test_a_service_has_one_battery(words, battery, can, tmp_path):
    found = settings(tmp_path, *words.split())
    assert (found.battery, found.can) == (battery, can)


def test_a_second_battery_is_refused_with_what_to_do_instead(tmp_path):
    with pytest.raises(ConfigError, match=r"battery = front, rear: one battery per service: .* --port .* --data"):
        settings(tmp_path, "--battery", "front", "--battery", "rear")
