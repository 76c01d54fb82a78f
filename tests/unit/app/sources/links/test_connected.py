"""A look at a port: what arrives, and what to do where that is not right."""

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from app.errors import ConfigError
from app.sources.links import connected
from app.sources.links.connected import look_at_can, look_at_serial
from firmware_protocol.framing import encode_frame


@pytest.fixture(autouse=True)
def short(monkeypatch):
    monkeypatch.setattr(connected, "LOOK_S", 0.4)


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


def test_a_port_that_is_not_there_says_what_to_do():
    look = look_at_serial("/dev/ttyUSB77")
    assert (look.bytes, look.frames) == (0, 0)
    assert look.error is not None
    assert look.advice.code == "advice-no-port"


def test_a_silent_port_says_what_to_do():
    with speaking(b"") as url:
        look = look_at_serial(url)
    assert (look.bytes, look.error, look.advice.code) == (0, None, "advice-silent")


def test_a_port_of_another_device_says_so():
    with speaking(b"$GPGGA,hello\r\n") as url:
        look = look_at_serial(url)
    assert look.bytes > 0
    assert (look.frames, look.advice.code) == (0, "advice-no-frame")


def test_a_master_is_counted_in_frames():
    with speaking(encode_frame(1, 0, 7, b"12345678")) as url:
        look = look_at_serial(url)
    assert look.frames > 0
    assert look.advice is None


def test_what_is_no_url_is_an_error_that_names_it():
    with pytest.raises(ConfigError, match="serial"):
        look_at_serial("foo://bar")
    with pytest.raises(ConfigError, match="can"):
        look_at_can("can0")


def test_a_bus_that_cannot_be_opened_says_what_to_do():
    look = look_at_can("socketcan:no_such_bus")
    assert look.error is not None
    assert look.advice.code == "advice-can-open"


def test_a_silent_bus_says_what_to_do():
    look = look_at_can("virtual:nobody-speaks")
    assert (look.frames, look.error, look.advice.code) == (0, None, "advice-can-silent")
