"""Serial ports and CAN adapters of this machine, with what they report of themselves."""

import contextlib
import json
import subprocess
from dataclasses import dataclass
from pathlib import Path

from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from app.sources.links.can_bus import can

_NO_ADAPTERS = ("virtual", "udp_multicast", "serial", "socketcan", "socketcand")
# on every machine, listed by the system, or on the network: a search there takes all of its time
_SEARCH_S = 3.0
_IP_S = 2.0
_SYSTEM = Path("/sys/class")
_ARPHRD_CAN = "280"  # linux/if_arp.h


@dataclass(frozen=True, slots=True)
class Plugged:
    """A port or an adapter; empty: it does not say."""

    url: str  # as `--serial` or `--can` takes it
    description: str = ""
    usb_id: str = ""  # VID:PID
    driver: str = ""
    bit_rate: int | None = None  # that the system has set [bit/s]
    is_up: bool = True


def serial_ports() -> list[Plugged]:
    """Return the serial ports of this machine; those of adapters on USB come first."""
    ports = sorted(list_ports.comports(), key=lambda port: (port.vid is None, port.device))
    return [_port(port, port.device) for port in ports]


def _port(port: ListPortInfo, url: str) -> Plugged:
    usb_id = "" if port.vid is None else f"{port.vid:04X}" + ("" if port.pid is None else f":{port.pid:04X}")
    described = "" if port.description in ("n/a", None) else str(port.description)
    return Plugged(url, described, usb_id, _driver(_SYSTEM / "tty" / Path(port.device).name))


def _driver(device: Path) -> str:
    """The kernel's driver of a device; Windows and macOS have no such folder."""
    with contextlib.suppress(OSError):
        return (device / "device" / "driver").resolve(strict=True).name
    return ""


def can_adapters() -> list[Plugged]:
    """Return the system's CAN interfaces, what python-can's drivers find, then serial adapters: they may be SLCAN."""
    named = [name for name in can.VALID_INTERFACES if name not in _NO_ADAPTERS]
    adapters = [
        Plugged(
            f"{config['interface']}:{config['channel']}", str(config.get("device_name", "")), driver=config["interface"]
        )
        for config in can.detect_available_configs(named, timeout=_SEARCH_S)
    ]
    usb = [port for port in list_ports.comports() if port.vid is not None]
    return _system_interfaces() + adapters + [_port(port, f"slcan:{port.device}") for port in usb]


def _system_interfaces() -> list[Plugged]:
    """SocketCAN's interfaces, those that are down too, with the bit rate that `ip` reports."""
    adapters = []
    for path in sorted(_SYSTEM.glob("net/*")):
        with contextlib.suppress(OSError):
            if (path / "type").read_text().strip() == _ARPHRD_CAN:
                is_up = int((path / "flags").read_text(), 16) & 1 == 1
                rate = bit_rate_in(_ip_text(path.name))
                adapters.append(Plugged(f"socketcan:{path.name}", "", "", _driver(path), rate, is_up))
    return adapters


def _ip_text(interface: str) -> str:
    command = ["ip", "-json", "-details", "link", "show", interface]
    with contextlib.suppress(OSError, subprocess.SubprocessError):
        return subprocess.run(command, capture_output=True, text=True, timeout=_IP_S, check=True).stdout
    return ""


def bit_rate_in(text: str) -> int | None:
    """Return the bit rate in what `ip -json -details link show` prints [bit/s], None where there is none."""
    with contextlib.suppress(ValueError, LookupError, TypeError, RecursionError):
        return int(json.loads(text)[0]["linkinfo"]["info_data"]["bittiming"]["bitrate"])
    return None
