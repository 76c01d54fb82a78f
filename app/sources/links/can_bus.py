"""CAN buses by their URLs: which a request may name, python-can's arguments, and opening one.

A request names an interface with a channel of its form, and options that name no file. The operator's command line
names any interface and option of python-can, of which some open files and load libraries.
"""

import contextlib
import ipaddress
import re
import sys
from collections.abc import Mapping
from typing import cast
from urllib.parse import parse_qsl

from app.errors import ConfigError, message_of
from app.sources.links.serial_url import check_url
from app.words import Message, Text

# python-can tries to import asammdf for files that nobody reads here; where that is installed (for exports) it brings
# pandas and pyarrow: 80 MB and two seconds of every start
_hides_asammdf = "asammdf" not in sys.modules
if _hides_asammdf:
    sys.modules["asammdf"] = None  # type: ignore[assignment]
try:
    import can as can
finally:
    if _hides_asammdf:
        del sys.modules["asammdf"]


DEFAULT_BIT_RATE = 500_000
Value = str | int | float | bool
SERIAL_INTERFACES = ("slcan", "robotell", "seeedstudio", "serial")  # whose channel is a serial port
_WITH_RATE = SERIAL_INTERFACES[:2]  # slcan:/dev/ttyACM0@115200
_COMMON = ("bitrate", "data_bitrate", "fd", "receive_own_messages", "listen_only")
_TIMING = tuple(f"{phase}_{part}" for phase in ("nom", "data") for part in ("brp", "tseg1", "tseg2", "sjw"))
_VECTOR_TIMING = tuple(f"{part}_{phase}" for phase in ("abr", "dbr") for part in ("sjw", "tseg1", "tseg2"))
_OPTIONS: Mapping[str, tuple[str, ...]] = {  # beyond the common ones
    "canalystii": ("device",),
    "cantact": (),
    "etas": (),
    "gs_usb": (),
    "iscan": (),
    "ixxat": ("unique_hardware_id",),
    "kvaser": (),
    "neousys": ("device",),
    "neovi": ("serial",),
    "nican": (),
    "nixnet": (),
    "pcan": ("device_id", "f_clock", "f_clock_mhz", *_TIMING),
    "robotell": ("ttyBaudrate", "rtscts"),
    "seeedstudio": ("baudrate", "timeout", "frame_type", "operation_mode"),
    "serial": ("baudrate", "timeout", "rtscts"),
    "slcan": ("tty_baudrate", "ttyBaudrate", "sleep_after_open", "rtscts", "timeout"),
    "socketcan": ("local_loopback", "ignore_rx_error_frames"),
    "socketcand": ("host", "port", "tcp_tune"),
    "systec": (),
    "udp_multicast": ("port",),
    "usb2can": (),
    "vector": ("serial", *_VECTOR_TIMING),
    "virtual": (),
}
_WAITS = ("timeout", "sleep_after_open")
_MOST_S = 10.0  # upper bound of the options in seconds
_CHANNEL = r"[\w.,: -]{1,64}"
_CHANNELS = {"socketcan": r"[\w.-]{1,15}", "socketcand": r"[\w.-]{1,15}", "etas": r"ETAS://[\w/:.-]{1,64}"}
_TEXT = r"[\w.:-]{1,64}"
_MOST_NUMBER = 1e12


def check_channel(url: str, interface: str, channel: str, *, by_operator: bool) -> None:
    """Refuse the channel of a serial adapter that is no serial port.

    Raises:
        ConfigError: see `check_url`.
    """
    if interface not in SERIAL_INTERFACES:
        return
    port = re.sub(r"@[0-9]{1,9}\Z", "", channel) if interface in _WITH_RATE else channel
    try:
        check_url(port, by_operator=by_operator)
    except ConfigError as error:
        raise ConfigError("can", url, error.limit) from error


def check_request(url: str, interface: str, channel: str, options: Mapping[str, Value]) -> None:
    """Refuse a bus that a request may not name.

    Raises:
        ConfigError: names the interface, the channel or the option, and what may stand there.
    """
    if interface not in _OPTIONS:
        raise ConfigError("can", url, Message("can-interface", names=tuple(_OPTIONS)))
    if interface not in SERIAL_INTERFACES and not _is_channel(interface, channel):
        raise ConfigError("can", url, Message("can-channel", channel=channel, interface=interface))
    allowed = (*_COMMON, *_OPTIONS[interface])
    for name, value in options.items():
        if name not in allowed:
            raise ConfigError("can", url, Message("can-option", option=name, interface=interface, names=allowed))
        if not _is_value(name, value):
            raise ConfigError("can", url, Message("can-option-value", option=name, value=value, most=_MOST_S))


def _is_channel(interface: str, channel: str) -> bool:
    if interface != "udp_multicast":
        return re.fullmatch(_CHANNELS.get(interface, _CHANNEL), channel, re.ASCII) is not None
    try:
        return ipaddress.ip_address(channel).is_multicast
    except ValueError:
        return False


def _is_value(name: str, value: Value) -> bool:
    if name in _WAITS:
        return isinstance(value, int | float) and 0 <= value <= _MOST_S
    if isinstance(value, str):
        return re.fullmatch(_TEXT, value, re.ASCII) is not None
    return abs(value) < _MOST_NUMBER


_NOT_THERE = ("No such device", "No such file", "FileNotFoundError")
_FD_LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)  # bytes, by their code
_DIGITS = {"t": 3, "d": 3, "b": 3, "T": 8, "x": 8, "D": 8, "B": 8}  # digits of the id
_TIMESTAMP = 4  # digits that some adapters append


def is_whole(line: str) -> bool:
    """Return whether a line of the adapter is an answer, or a frame with exactly the bytes that it announces."""
    digits = _DIGITS.get(line[:1])
    if digits is None:
        return True
    body = line.rstrip("\r\a")
    try:
        length = _FD_LENGTHS[int(body[1 + digits], 16)]
        int(body[1:], 16)
    except (IndexError, ValueError):
        return False
    return len(body) - 2 - digits - 2 * length in (0, _TIMESTAMP)


def open_bus(arguments: dict[str, str | int | float | bool]) -> can.BusABC:
    """Open a bus by python-can's arguments; every driver raises its own errors."""
    if arguments["interface"] != "slcan":
        return can.Bus(**arguments)  # type: ignore[arg-type]
    return cast("can.BusABC", _whole_lines_bus()(**{k: v for k, v in arguments.items() if k != "interface"}))


def bus_reason(error: BaseException, url: str) -> Text:
    """One line about a bus that cannot be opened; one that is not there is named."""
    if any(text in str(error) for text in _NOT_THERE):
        return Message("adapter-missing", adapter=url)
    return message_of(error)


def _whole_lines_bus() -> type:
    from can.interfaces.slcan import slcanBus

    class WholeLinesBus(slcanBus):
        """The protocol has no checksum, and python-can takes a line as long as it needs and leaves the rest.

        Where an overloaded computer loses some bytes, two lines become one, and the cells of one frame get the voltages
        of another. Lines of the same length that were cut and joined at the same place are the only ones that pass.
        """

        def _read(self, timeout: float | None) -> str | None:
            line = super()._read(timeout)
            return line if line is None or is_whole(line) else ""

    return WholeLinesBus


def parse_bus(text: str, *, by_operator: bool = False) -> dict[str, Value]:
    """Return python-can's arguments for INTERFACE:CHANNEL[?key=value&...]; numbers and true/false are converted.

    Args:
        text: of the bus.
        by_operator: the command line or the environment names it: any interface and any option.

    Raises:
        ConfigError: no colon, an interface that python-can does not have, a part that is not key=value, the channel
            of a serial adapter that is no serial port, or what a request may not name.
    """
    interface, colon, rest = text.partition(":")
    if not colon or not interface or not rest:
        raise ConfigError("can", text, Message("can-url"))
    if interface not in can.VALID_INTERFACES:
        raise ConfigError("can", text, Message("can-interface", names=tuple(sorted(can.VALID_INTERFACES))))
    channel, _, query = rest.partition("?")
    try:
        pairs = parse_qsl(query, strict_parsing=True) if query else []
    except ValueError as error:
        raise ConfigError("can", text, Message("can-options")) from error
    options = {key: _convert(value) for key, value in pairs}
    if not by_operator:
        check_request(text, interface, channel, options)
    check_channel(text, interface, channel, by_operator=by_operator)
    return {"bitrate": DEFAULT_BIT_RATE, **options, "interface": interface, "channel": channel}


def bit_rate_of(url: str | None) -> int | None:
    """Return the bit rate that a bus is named with, None where it is not [bit/s]."""
    rate = None if url is None or not re.search(r"[?&]bitrate=", url) else parse_bus(url, by_operator=True)["bitrate"]
    return rate if type(rate) is int and rate > 0 else None


def _convert(value: str) -> Value:
    if value.lower() in ("true", "false"):
        return value.lower() == "true"
    for kind in (int, float):
        with contextlib.suppress(ValueError):
            return kind(value)
    return value
