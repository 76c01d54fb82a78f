"""What a link may be opened from, and what is refused before a port is touched."""

import pytest

from app.errors import ConfigError
from app.sources.links.can import DEFAULT_BIT_RATE, parse_bus
from app.sources.links.serial import check_url


@pytest.mark.parametrize(
    ("text", "arguments"),
    [
        ("socketcan:can0", {"interface": "socketcan", "channel": "can0", "bitrate": DEFAULT_BIT_RATE}),
        ("virtual:a?bitrate=250000", {"interface": "virtual", "channel": "a", "bitrate": 250_000}),
        ("slcan:/dev/ttyACM0", {"interface": "slcan", "channel": "/dev/ttyACM0", "bitrate": DEFAULT_BIT_RATE}),
        (
            "virtual:a?fd=true&x=False&y=1.5&z=abc&n=-3",
            {"interface": "virtual", "channel": "a", "bitrate": 500_000, "fd": True, "x": False, "y": 1.5, "z": "abc",
             "n": -3},
        ),
        ("virtual:a:b", {"interface": "virtual", "channel": "a:b", "bitrate": 500_000}),
    ],
)  # fmt: skip
def test_a_bus_has_an_interface_a_channel_and_arguments(text, arguments):
    found = parse_bus(text)
    assert found == arguments
    assert {name: type(value) for name, value in found.items()} == {n: type(v) for n, v in arguments.items()}


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "INTERFACE:CHANNEL"),
        ("can0", "INTERFACE:CHANNEL"),
        (":can0", "INTERFACE:CHANNEL"),
        ("socketcan:", "INTERFACE:CHANNEL"),
        ("telepathy:can0", "an interface of python-can: .*socketcan"),
        ("virtual:a?bitrate", "only key=value"),
        ("virtual:a?=5&", "only key=value"),
    ],
)
def test_what_is_no_bus_says_what_one_is(text, reason):
    with pytest.raises(ConfigError, match=reason) as refused:
        parse_bus(text)
    assert refused.value.args


@pytest.mark.parametrize(
    "url", ["/dev/ttyUSB0", "COM6", "socket://localhost:5000", "rfc2217://10.0.0.7:4000", "/nowhere/yet"]
)
def test_a_port_that_may_come_later_is_accepted(url):
    check_url(url)


@pytest.mark.parametrize("url", ["telepathy://x", "socket://", "socket://host", "rfc2217://host", "socket://host:port"])
def test_an_address_from_which_nothing_can_be_opened_is_refused(url):
    with pytest.raises(ConfigError, match="a device as /dev/ttyUSB0 or COM6"):
        check_url(url)
