"""A look at a bus: frames, bit rates, whose messages."""

import errno
import os
import threading

import can
import pytest

from app.errors import ConfigError
from app.sources.connections import Connections, Setup
from app.sources.dbc.parts import bundled_parts
from app.sources.link_check import can_check
from app.sources.link_check.can_check import check_can, with_bit_rate
from app.sources.links.can_bus import bus_reason
from app.words import Message


@pytest.fixture(autouse=True)
def short(monkeypatch):
    monkeypatch.setattr(can_check, "CHECK_S", 0.4)


def test_what_is_no_url_is_an_error_that_names_it():
    with pytest.raises(ConfigError, match="can"):
        check_can("can0")


@pytest.mark.parametrize(
    ("url", "advice"),
    [("socketcan:no_such_bus", "advice-can-open"), ("virtual:nobody-speaks", "advice-can-system-rate")],
)
def test_a_bus_that_cannot_be_opened_or_is_silent_says_what_to_do(url, advice):
    look = check_can(url)
    assert (look.frames, look.error is None, look.advice.code) == (0, advice == "advice-can-system-rate", advice)


def test_a_bus_that_speaks_is_counted_in_frames_and_bytes():
    stopped = threading.Event()

    def speak(node):
        while not stopped.wait(0.01):
            node.send(can.Message(arbitration_id=0x10, is_extended_id=False, data=b"\x01\x02\x03"))

    with can.Bus("speaks", interface="virtual") as node:
        thread = threading.Thread(target=speak, args=(node,), daemon=True)
        thread.start()
        look = check_can("virtual:speaks")
        stopped.set()
        thread.join()
    assert look.frames > 0
    assert (look.bytes, look.error, look.advice) == (3 * look.frames, None, None)


def test_a_bus_that_is_not_there_is_named():
    missing = OSError(errno.ENODEV, os.strerror(errno.ENODEV))  # as socketcan raises it
    assert bus_reason(missing, "socketcan:can7") == Message("adapter-missing", adapter="socketcan:can7")
    url = "slcan:/dev/ttyACM77?sleep_after_open=0"
    assert check_can(url).error == Message("adapter-missing", adapter=url)


@pytest.mark.parametrize(
    ("url", "expected"),
    [
        ("slcan:COM5", "slcan:COM5?bitrate=250000"),
        ("slcan:COM5?bitrate=500000", "slcan:COM5?bitrate=250000"),
        ("slcan:COM5?bitrate=500000&timeout=1", "slcan:COM5?timeout=1&bitrate=250000"),
        ("slcan:COM5?timeout=1&bitrate=500000&fd=true", "slcan:COM5?timeout=1&fd=true&bitrate=250000"),
    ],
)
def test_a_bit_rate_takes_the_place_of_the_one_before(url, expected):
    assert with_bit_rate(url, 250_000) == expected


def test_the_messages_of_batteries_and_parts_are_recognised(tmp_path):
    parts = bundled_parts()
    assert set(parts) == {"ivt-s"}
    batteries = Setup(tmp_path, Connections()).batteries()
    known = {name: each.definitions for name, each in batteries.items() if each.kind == "dbc"}
    ids = [each.can_id for each in parts["ivt-s"].messages]
    stopped = threading.Event()

    def send(node):
        while not stopped.wait(0.005):
            for can_id in ids:
                node.send(can.Message(arbitration_id=can_id, is_extended_id=False, data=bytes(6)))

    with can.Bus("ivt", interface="virtual") as node:
        thread = threading.Thread(target=send, args=(node,), daemon=True)
        thread.start()
        found = check_can("virtual:ivt", {**known, **parts})
        stopped.set()
        thread.join()
    assert found.batteries == ("ivt-s",)
