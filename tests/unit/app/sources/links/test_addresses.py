"""What a link may be opened from, and what is refused before a port is touched."""

import os
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.errors import ConfigError
from app.sources.links.can_bus import DEFAULT_BIT_RATE, can, is_whole, open_bus, parse_bus
from app.sources.links.serial_url import check_url, open_port
from tests.campaign import examples

POSIX = pytest.mark.skipif(sys.platform == "win32", reason="character devices of a POSIX system")


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
    found = parse_bus(text, by_operator=True)
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


PORTS = [
    "/dev/ttyUSB0",
    "/dev/ttyACM17",
    "/dev/cu.usbserial-1410",
    "/dev/serial/by-id/usb-FTDI_FT232R_USB_UART_A10K-if00-port0",
    "/dev/bms",
    "COM6",
    r"\\.\COM12",
    "socket://localhost:5000",
    "socket://[::1]:5000?logging=debug",
    "rfc2217://10.0.0.7:4000?ign_set_control&poll_modem&timeout=3",
]
NO_PORTS = [  # for anybody
    "",
    "telepathy://x",
    "socket://",
    "socket://host",
    "rfc2217://host",
    "socket://host:port",
    "socket://host:1?file=/tmp/x",
    "socket://user:secret@host:1",
    "socket://host:1/tmp/x",
    "rfc2217://host:1?timeout=1e9",
    "rfc2217://host:1?timeout=nan",
    "rfc2217://host:1?logging=/tmp/x",
    "spy:///dev/null?file={victim}",
    "SPY:///dev/null?file={victim}",
    "spy://socket://h:1?file={victim}",
    "alt:///dev/ttyUSB0?class=PosixPollSerial",
    "hwgrep://.*",
    "cp2110://x",
    "file://{victim}",
    "{victim}",
    "/dev/ttyUSB0\n",
    "/dev/tty\0USB0",
    " spy:///dev/null?file={victim}",
    "/dev/shm",
]
NOT_FOR_REQUESTS = [
    "/nowhere/yet",
    "car",
    "{link}",  # to a character device
    "/dev/../etc/passwd",
    "/dev/./null",
    "/dev//ttyUSB0",
    "/dev/shm/anything",
    "/dev/fd/5",
    "/dev/stdin",
    "/dev/null",
    "/dev/zero",
    "/dev/tty",
    "/dev/pts/ptmx",
    "loop://",
]


@pytest.fixture
def victim(tmp_path):
    """A file of the service, and a link to a character device."""
    path = tmp_path / "accounts.json"
    path.write_text("whole")
    (tmp_path / "link").symlink_to(os.devnull)
    yield path
    assert path.read_text() == "whole"


@pytest.mark.parametrize("url", PORTS)
def test_a_port_that_may_come_later_is_accepted(url):
    check_url(url)
    check_url(url, by_operator=True)


@pytest.mark.parametrize("url", NO_PORTS)
def test_what_is_no_serial_port_is_refused_and_nothing_is_opened(url, victim):
    for by_operator in (False, True):
        with pytest.raises(
            ConfigError, match=r"(?s)serial = .*/dev/ttyUSB0 or COM6|serial = .*does not support option"
        ):
            check_url(url.format(victim=victim), by_operator=by_operator)
    with pytest.raises(ConfigError):
        open_port(url.format(victim=victim), 0.1)


@POSIX
@pytest.mark.parametrize("url", NOT_FOR_REQUESTS)
def test_a_request_names_serial_devices_alone(url, victim):
    with pytest.raises(ConfigError, match=r"serial = .*/dev/ttyUSB0 or COM6"):
        check_url(url.format(link=victim.with_name("link")))


@POSIX
@pytest.mark.parametrize("url", ["/nowhere/yet", "{link}", "loop://"])
def test_the_command_line_also_names_links_to_character_devices(url, victim):
    check_url(url.format(link=victim.with_name("link")), by_operator=True)


@POSIX
def test_a_link_in_dev_has_to_lead_to_a_serial_device(tmp_path):
    for link in Path("/dev").iterdir():
        if link.is_symlink() and not link.resolve().name.startswith(("ttyUSB", "ttyACM", "ttyS", "ttyAMA")):
            with pytest.raises(ConfigError):
                check_url(str(link))


@pytest.mark.parametrize(
    "text",
    [
        "socketcan:can0",
        "pcan:PCAN_USBBUS1?bitrate=250000",
        "vector:0,1?data_bitrate=2000000&fd=true",
        "kvaser:0",
        "virtual:a",
        "udp_multicast:239.74.163.2?port=5000",
        "socketcand:can0?host=10.0.0.7&port=29536",
        "slcan:/dev/ttyACM0@115200?sleep_after_open=0.5",
        "slcan:COM7",
        "slcan:socket://10.0.0.7:4000",
    ],
)
def test_a_request_may_name_a_bus_of_an_adapter(text):
    assert parse_bus(text) == parse_bus(text, by_operator=True)


@pytest.mark.parametrize(
    "text",
    [
        "socketcan:/etc/passwd",
        "socketcan:../can0",
        "virtual:a?file={victim}",
        "virtual:a?logfile={victim}",
        "virtual:a?config_context=x",
        "usb2can:ED000200?dll={victim}",
        "neovi:1?override_library_name={victim}",
        "vector:0?app_name=Other",
        "pcan:PCAN_USBBUS1?state=x",
        "pcan:{victim}",
        "neovi:1?serial={victim}",
        "socketcand:can0?host=http://x/&port=1",
        "udp_multicast:10.0.0.1",
        "udp_multicast:239.0.0.1?hop_limit=255",
        "slcan:/dev/ttyACM0?sleep_after_open=1e9",
        "slcan:/dev/ttyACM0?timeout=nan",
        "slcan:{link}",
        "slcan:loop://",
        "slcan:/dev/null",
        "serial:{victim}",
        "robotell:/dev/shm/x",
        "seeedstudio:/dev/fd/3",
    ],
)
def test_a_request_names_no_file_by_a_bus(text, victim):
    with pytest.raises(ConfigError, match=r"can = "):
        parse_bus(text.format(victim=victim, link=victim.with_name("link")))


@pytest.mark.parametrize("interface", ["slcan", "serial", "robotell", "seeedstudio"])
def test_the_channel_of_a_serial_adapter_is_a_serial_port_for_anybody(interface, victim):
    rated = f"{victim}@115200" if interface in ("slcan", "robotell") else str(victim)
    for channel in ("spy:///dev/null", "spy:///dev/null@115200", "hwgrep://x", str(victim), rated):
        for by_operator in (False, True):
            with pytest.raises(ConfigError, match="can = "):
                parse_bus(f"{interface}:{channel}", by_operator=by_operator)


def test_an_interface_of_a_plugin_is_for_the_command_line_alone(monkeypatch):
    monkeypatch.setattr(can, "VALID_INTERFACES", {*can.VALID_INTERFACES, "plugin"})
    assert parse_bus("plugin:/any?file=x", by_operator=True)["file"] == "x"
    with pytest.raises(ConfigError, match="socketcan"):
        parse_bus("plugin:a")


def line(kind, can_id, data):
    code = (*range(9), 12, 16, 20, 24, 32, 48, 64).index(len(data))
    width = 3 if kind in "tdb" else 8
    return f"{kind}{can_id:0{width}X}{code:X}{data.hex().upper()}\r"


@given(st.sampled_from("tTdDbB"), st.integers(0, 0x7FF), st.sampled_from([1, 7, 8, 12, 48, 64]), st.data())
def test_a_whole_line_counts_and_one_that_lost_bytes_does_not(kind, can_id, length, draw):
    if kind in "tT" and length > 8:
        length = 8
    whole = line(kind, can_id, bytes(range(length)))
    assert is_whole(whole)
    assert is_whole(whole[:-1] + "1A2F\r")  # with the adapter's timestamp
    header = 5 if kind in "tdb" else 10
    first = draw.draw(st.integers(header, len(whole) - 2))
    lost = draw.draw(st.integers(1, len(whole) - 1 - first))
    assert not is_whole(whole[:first] + whole[first + lost :])  # bytes of the data
    assert not is_whole(whole[:first] + whole)  # the end of the line, and the next one is whole


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        *((answer, True) for answer in ("\r", "\a", "z\r", "F00\r", "V1013\r")),
        *((cut, False) for cut in ("t", "t100\r", "t1009\r", "tXYZ20102\r", "t10020102t10020102\r")),
    ],
)
def test_answers_are_left_alone_and_what_is_no_frame_is_none(text, expected):
    assert is_whole(text) is expected


@pytest.fixture
def adapter():
    """A bus whose serial port hears what is written to it."""
    bus = open_bus({"interface": "slcan", "channel": "loop://", "bitrate": 500_000, "sleep_after_open": 0.0})
    while bus.serialPortOrig.in_waiting:
        bus.recv(0.0)  # the commands that opened it
    yield bus
    bus.shutdown()


def received(adapter, *lines):
    adapter.serialPortOrig.write("".join(lines).encode())
    found = []
    while adapter.serialPortOrig.in_waiting:
        message = adapter.recv(0.05)
        found += [] if message is None else [(message.arbitration_id, bytes(message.data))]
    return found


def test_an_adapter_delivers_whole_frames_of_both_kinds_of_id(adapter):
    first, second = line("t", 0x7FF, b"\x01\x02"), line("T", 0x18FF50E5, bytes(8))
    assert received(adapter, first, second) == [(0x7FF, b"\x01\x02"), (0x18FF50E5, bytes(8))]


def test_two_lines_that_became_one_are_no_frame_and_the_next_one_is(adapter):
    first, second, third = (line("t", i, bytes([i] * 8)) for i in (1, 2, 3))
    assert received(adapter, first[:9] + second, third) == [(3, bytes([3] * 8))]
    assert received(adapter, first[:-3] + "\r", second) == [(2, bytes([2] * 8))]


@settings(max_examples=examples(15))
@given(st.binary(min_size=8, max_size=8), st.binary(min_size=8, max_size=8), st.integers(5, 20), st.integers(1, 15))
def test_bytes_that_are_lost_behind_an_id_give_no_cell_the_value_of_another_frame(first, second, begin, lost):
    lines = line("t", 0x100, first) + line("t", 0x101, second)
    damaged = lines[:begin] + lines[begin + lost :]
    for each in damaged.split("\r"):
        if each[:1] == "t" and is_whole(each + "\r"):
            found = int(each[1:4], 16), bytes.fromhex(each[5:21])
            assert found in ((0x100, first), (0x101, second))
