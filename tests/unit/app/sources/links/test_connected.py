"""A look at a port: what arrives, and what to do where that is not right."""

import errno
import os
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import can
import pytest
import serial
from serial.tools import list_ports

from app.errors import ConfigError
from app.sources.links import connected
from app.sources.links.can_bus import parse_bus
from app.sources.links.connected import Found, can_adapters, check_can, check_serial, serial_ports
from app.sources.loaded_battery import load_battery
from app.sources.serial.framing import frame_counter
from app.words import Message
from firmware_protocol.framing import encode_frame
from tests.unit.app.sources.serial.test_serial_frames import JBD_CELLS


@pytest.fixture(autouse=True)
def short(monkeypatch):
    monkeypatch.setattr(connected, "CHECK_S", 0.4)


@contextmanager
def speaking(data: bytes) -> Iterator[str]:
    """A port on this machine that says the same all the time."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            with server.accept()[0] as peer:
                try:
                    while data:
                        peer.sendall(data)
                    peer.recv(2)
                    peer.recv(1)
                except OSError:
                    return

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        yield f"socket://127.0.0.1:{server.getsockname()[1]}"
        thread.join(5)


@pytest.mark.parametrize(
    ("data", "advice"),
    [
        (b"", "advice-silent"),
        (b"$GPGGA,hello\r\n", "advice-no-frame"),
        (encode_frame(1, 0, 7, b"12345678"), None),
    ],
    ids=["silent", "another device", "a master"],
)
def test_a_port_is_looked_at_for_frames_and_says_what_to_do_without(data, advice):
    with speaking(data) as url:
        look = check_serial(url)
    assert (look.bytes > 0, look.frames > 0, look.error) == (bool(data), advice is None, None)
    assert (look.advice and look.advice.code) == advice


def test_what_is_no_url_is_an_error_that_names_it():
    with pytest.raises(ConfigError, match="serial"):
        check_serial("foo://bar")
    with pytest.raises(ConfigError, match="can"):
        check_can("can0")


@pytest.mark.parametrize(
    ("url", "advice"),
    [("socketcan:no_such_bus", "advice-can-open"), ("virtual:nobody-speaks", "advice-can-silent")],
)
def test_a_bus_that_cannot_be_opened_or_is_silent_says_what_to_do(url, advice):
    look = check_can(url)
    assert (look.frames, look.error is None, look.advice.code) == (0, advice == "advice-can-silent", advice)


@dataclass
class Port:
    """A port as pySerial lists it."""

    device: str
    description: str | None = "n/a"
    vid: int | None = None


PORTS = [Port("/dev/ttyS0"), Port("/dev/ttyUSB1", "FT232R", 0x403), Port("/dev/ttyACM0", None, 0x16D0)]


def test_ports_of_adapters_on_usb_come_first_and_what_is_unknown_is_empty(monkeypatch):
    monkeypatch.setattr(list_ports, "comports", lambda: PORTS)
    assert serial_ports() == [Found("/dev/ttyACM0", ""), Found("/dev/ttyUSB1", "FT232R"), Found("/dev/ttyS0", "")]


def test_can_adapters_are_named_as_the_option_takes_them_and_serial_ones_may_speak_slcan(monkeypatch):
    asked = []

    def detected(names, timeout):
        asked.extend(names)
        return [
            {"interface": "socketcan", "channel": "can0"},
            {"interface": "pcan", "channel": "P1", "device_name": "USB"},
        ]

    monkeypatch.setattr(can, "detect_available_configs", detected)
    monkeypatch.setattr(list_ports, "comports", lambda: PORTS)
    assert can_adapters() == [
        Found("socketcan:can0", ""),
        Found("pcan:P1", "USB"),
        Found("slcan:/dev/ttyUSB1", "FT232R"),
        Found("slcan:/dev/ttyACM0", ""),
    ]
    for found in can_adapters():
        parse_bus(found.url)
    assert not {"virtual", "udp_multicast", "serial"} & set(asked), "those are no adapters of this machine"


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


@pytest.mark.parametrize(
    ("number", "advice"),
    [(errno.EACCES, "advice-denied"), (errno.EBUSY, "advice-in-use"), (errno.EIO, "advice-no-port")],
)
def test_what_to_do_depends_on_why_the_port_cannot_be_opened(monkeypatch, number, advice):
    def refuse(*_, **__):
        raise serial.SerialException(number, os.strerror(number))

    monkeypatch.setattr(serial, "serial_for_url", refuse)
    look = check_serial("/dev/ttyUSB0")
    assert look.error is not None
    assert (look.bytes, look.frames, look.advice.code) == (0, 0, advice)


def test_a_port_that_is_lost_while_it_is_looked_at_says_so_and_is_closed(monkeypatch):
    class Pulled:
        in_waiting, is_open = 0, True

        def write(self, data):
            return len(data)

        def read(self, size):
            raise OSError("device reports readiness to read but returned no data")

        def close(self):
            self.is_open = False

    port = Pulled()
    monkeypatch.setattr(serial, "serial_for_url", lambda *_, **__: port)
    look = check_serial("/dev/ttyUSB0")
    assert (look.frames, look.advice.code) == (0, "advice-no-port")
    assert look.error is not None
    assert not port.is_open


def test_a_line_that_a_profile_describes_is_counted_by_its_frames():
    jbd, daly = load_battery("jbd").serial, load_battery("daly").serial
    with speaking(JBD_CELLS) as url:
        assert check_serial(url, jbd, frame_counter(jbd)).frames > 0
    with speaking(JBD_CELLS) as url:
        found = check_serial(url, daly, frame_counter(daly))
    assert (found.bytes > 0, found.frames, found.advice) == (True, 0, Message("advice-no-frame"))
