"""Serial ports by their URL: which ones may be named, and opening one. Nothing is opened to be checked.

pySerial knows schemes that write files (`spy://`) or search the machine (`hwgrep://`): only the listed ones are passed
to it. A request may name fewer ports than the operator's command line.
"""

import contextlib
import math
import os
import re
import stat
from pathlib import Path
from urllib.parse import parse_qsl, urlsplit

import serial
from serial.tools import list_ports

from app.battery.serial import Port
from app.errors import ConfigError
from app.words import Message
from firmware_protocol.framing import BAUD_RATE, START_STREAM, STOP_STREAM

MASTER_PORT = Port(BAUD_RATE, "even", start=bytes([START_STREAM]), stop=bytes([STOP_STREAM]))
_PARITIES = {"none": serial.PARITY_NONE, "even": serial.PARITY_EVEN, "odd": serial.PARITY_ODD}
_OPTIONS = {
    "socket": ("logging",),
    "rfc2217": ("logging", "ign_set_control", "poll_modem", "timeout"),
    "loop": ("logging",),  # for tests
}
_LEVELS = ("debug", "info", "warning", "error")
MOST_TIMEOUT_S = 10.0
_WINDOWS_PORT = re.compile(r"(\\\\\.\\)?COM[0-9]{1,3}", re.IGNORECASE)
# No terminal of a person (/dev/tty1, /dev/pts/0, macOS's ttys000): what is typed there is not for a request to read
_SERIAL_NAME = re.compile(r"/dev/(tty([A-Z]\w*|mxc[0-9]+)|(tty|cu)\.[\w.+-]+|rfcomm[0-9]+)", re.ASCII)
_LINK_NAME = re.compile(r"/dev/(serial/by-(id|path)/)?[\w.:+-]+", re.ASCII)  # as udev makes them


def check_url(url: str, *, by_operator: bool = False) -> None:
    """Refuse what no serial port is, or none that a request may name; a device that is not there yet may come.

    Args:
        url: a device, socket://HOST:PORT or rfc2217://HOST:PORT.
        by_operator: the command line or the environment names it: any character device, and loop:// for tests.

    Raises:
        ConfigError: an unknown scheme or option, a network address without its port, or no serial device.
    """
    if not url.isprintable() or not url.isascii() or " " in url:
        raise ConfigError("serial", url, Message("serial-url"))
    if "://" in url:
        _check_address(url, by_operator=by_operator)
    elif os.name == "nt" or _WINDOWS_PORT.fullmatch(url):
        if not _WINDOWS_PORT.fullmatch(url):
            raise ConfigError("serial", url, Message("serial-url"))
    elif not (_is_character_device(url) if by_operator else _may_be_requested(url)):
        raise ConfigError("serial", url, Message("serial-device"))


def _check_address(url: str, *, by_operator: bool) -> None:
    scheme = url.partition("://")[0]
    if scheme not in _OPTIONS or (scheme == "loop" and not by_operator):
        raise ConfigError("serial", url, Message("serial-scheme", scheme=scheme))
    try:
        parts = urlsplit(url)
        is_address = bool(parts.hostname and parts.port) and "@" not in parts.netloc
    except ValueError:
        is_address = False
    if (scheme != "loop" and not is_address) or parts.path not in ("", "/") or parts.fragment:
        raise ConfigError("serial", url, Message("serial-url"))
    for option, value in parse_qsl(parts.query, keep_blank_values=True):
        if option not in _OPTIONS[scheme] or not _is_value(option, value):
            names = _OPTIONS[scheme]
            raise ConfigError("serial", url, Message("serial-option", option=option, scheme=scheme, names=names))


def _is_value(option: str, value: str) -> bool:
    if option == "logging":
        return value in _LEVELS
    if option != "timeout":
        return True  # a flag
    with contextlib.suppress(ValueError):
        return 0 < float(value) <= MOST_TIMEOUT_S and math.isfinite(float(value))
    return False


def _is_character_device(path: str) -> bool:
    """True also where nothing is there yet."""
    try:
        return stat.S_ISCHR(Path(path).stat().st_mode)
    except FileNotFoundError:
        return True
    except OSError:
        return False


def _may_be_requested(path: str) -> bool:
    """True for what the system lists as a serial port, and for names of such in /dev; a link has to lead to one."""
    if path in (port.device for port in list_ports.comports()):
        return _is_character_device(path)
    if not _LINK_NAME.fullmatch(path) or os.path.normpath(path) != path:
        return False
    return not Path(path).exists() or (
        _SERIAL_NAME.fullmatch(os.path.realpath(path)) is not None and _is_character_device(path)
    )


def open_port(url: str, timeout_s: float, port: Port = MASTER_PORT) -> serial.Serial:
    """Open a port; drivers raise their own errors.

    Raises:
        ConfigError: it is no serial port by now.
    """
    check_url(url, by_operator=True)
    return serial.serial_for_url(
        url,
        baudrate=port.baud,
        parity=_PARITIES[port.parity],
        bytesize=port.data_bits,
        stopbits=port.stop_bits,
        timeout=timeout_s,
        write_timeout=None if url.startswith("rfc2217://") else 1.0,  # pySerial's client has none
        exclusive=True,  # two readers would each get half of the bytes
    )


def set_port(opened: serial.Serial, port: Port) -> None:
    """Give an open port other settings."""
    opened.apply_settings(
        {
            "baudrate": port.baud,
            "parity": _PARITIES[port.parity],
            "bytesize": port.data_bits,
            "stopbits": port.stop_bits,
        }
    )
