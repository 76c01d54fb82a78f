"""Which CAN buses a request may name: per interface the form of its channel, and options that name no file.

The operator's command line names any interface and option of python-can, of which some open files and load libraries.
"""

import ipaddress
import re
from collections.abc import Mapping

from app.errors import ConfigError
from app.sources.links.serial_url import check_url
from app.words import Message

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
_MOST_S = 10.0  # of them
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
