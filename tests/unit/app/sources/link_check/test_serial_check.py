"""A look at a port: what arrives, and what to do where that is not right."""

import errno
import os
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace

import pytest
import serial
from serial import rfc2217

from app.battery.serial import Port
from app.errors import ConfigError
from app.sources.link_check import serial_check
from app.sources.link_check.serial_check import check_serial, setting_of
from app.sources.loaded_battery import load_battery
from app.words import Message
from firmware_protocol.framing import encode_frame
from tests.unit.app.sources.serial.test_serial_frames import JBD_CELLS


@pytest.fixture(autouse=True)
def short(monkeypatch):
    for name in ("CHECK_S", "BATTERY_S", "SETTING_S"):
        monkeypatch.setattr(serial_check, name, 0.4)


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


def mapping(name):
    return load_battery(name).serial


def test_a_line_that_a_profile_describes_is_counted_by_its_frames():
    with speaking(JBD_CELLS) as url:
        found = check_serial(url, mapping("jbd"))
    assert found.frames > 0
    assert found.rate_hz == pytest.approx(found.frames / found.seconds)
    assert found.has_checksum
    with speaking(JBD_CELLS) as url:
        found = check_serial(url, mapping("daly"))
    assert (found.bytes > 0, found.frames, found.advice) == (True, 0, Message("advice-no-frame", setting="9600 8N1"))
    assert found.has_checksum is None


def test_frames_of_another_battery_name_it_and_its_settings():
    others = {"daly": mapping("daly"), "thesis-struct": mapping("thesis-struct"), "jbd": mapping("jbd")}
    with speaking(JBD_CELLS) as url:
        found = check_serial(url, None, others)
    assert found.frames > 0
    assert found.batteries == ("jbd",)
    assert found.advice == Message("advice-other-battery", setting="9600 8N1")
    assert [(each.setting, each.battery, each.frames > 0) for each in found.trials] == [
        ("115200 8E1", None, False),
        ("9600 8N1", "daly", False),
        ("9600 8N1", "jbd", True),
    ], "one without a checksum proves nothing"


def test_a_master_of_ours_is_recognised_where_another_battery_was_chosen():
    with speaking(encode_frame(1, 0, 7, b"12345678")) as url:
        found = check_serial(url, mapping("jbd"), {"jbd": mapping("jbd"), "team": None})
    assert found.batteries == ("team",)
    assert found.frames > 0


@contextmanager
def a_line_set_to(port: Port, frame: bytes) -> Iterator[str]:
    """A serial server (RFC 2217) that sends a frame at these settings, and noise at any other."""
    ended = threading.Event()
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            with server.accept()[0] as peer, serial.serial_for_url("loop://") as line:
                peer.settimeout(0.01)
                manager = rfc2217.PortManager(line, SimpleNamespace(write=peer.sendall))
                while not ended.is_set():
                    try:
                        data = peer.recv(1024)
                        if not data:
                            return
                        b"".join(manager.filter(data))
                    except TimeoutError:
                        is_right = (line.baudrate, line.parity) == (port.baud, port.parity[0].upper())
                        noise = bytes(byte ^ 0x5A for byte in frame)
                        peer.sendall(b"".join(manager.escape(frame if is_right else noise)))
                    except OSError:
                        return

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        try:
            yield f"rfc2217://127.0.0.1:{server.getsockname()[1]}"
        finally:
            ended.set()
            thread.join(5)


@pytest.mark.filterwarnings("ignore::DeprecationWarning:serial")
@pytest.mark.parametrize("port", [Port(9600, "even"), Port(19_200, "none")], ids=["another parity", "another rate"])
def test_settings_that_give_frames_are_named_with_those_that_give_none(port):
    with a_line_set_to(port, JBD_CELLS) as url:
        found = check_serial(url, mapping("jbd"))
    assert found.frames > 0
    assert found.advice == Message("advice-other-setting", setting=setting_of(port), own="9600 8N1")
    tried = {each.setting: each.frames > 0 for each in found.trials}
    assert tried["9600 8N1"] is False
    assert tried[setting_of(port)] is True


def test_a_port_that_is_not_there_is_named():
    found = check_serial("/dev/ttyUSB77")
    assert found.error == Message("port-missing", port="/dev/ttyUSB77")


@pytest.mark.parametrize(("name", "has"), [("jbd", True), ("thesis-struct", False), ("ascii-line", False)])
def test_a_profile_without_a_checksum_is_known_as_one(name, has):
    assert mapping(name).has_checksum is has
