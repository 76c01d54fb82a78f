"""What is plugged in, with what it reports of itself."""

import json
from dataclasses import dataclass

import can
import pytest
from serial.tools import list_ports

from app.sources.link_check import plugged
from app.sources.link_check.plugged import Plugged, bit_rate_in, can_adapters, serial_ports
from app.sources.links.can_bus import parse_bus


@dataclass
class Port:
    """A port as pySerial lists it."""

    device: str
    description: str | None = "n/a"
    vid: int | None = None
    pid: int | None = None


PORTS = [Port("/dev/ttyS0"), Port("/dev/ttyUSB1", "FT232R", 0x403, 0x6001), Port("/dev/ttyACM0", None, 0x16D0)]


@pytest.fixture(autouse=True)
def system(monkeypatch, tmp_path):
    """The folder in which Linux lists devices."""
    monkeypatch.setattr(plugged, "_SYSTEM", tmp_path)
    return tmp_path


def test_ports_of_adapters_on_usb_come_first_and_what_is_unknown_is_empty(monkeypatch):
    monkeypatch.setattr(list_ports, "comports", lambda: PORTS)
    assert serial_ports() == [
        Plugged("/dev/ttyACM0", usb_id="16D0"),
        Plugged("/dev/ttyUSB1", "FT232R", "0403:6001"),
        Plugged("/dev/ttyS0"),
    ]


def test_a_port_names_its_driver(monkeypatch, system):
    driver = system / "drivers" / "ftdi_sio"
    driver.mkdir(parents=True)
    device = system / "tty" / "ttyUSB1" / "device"
    device.mkdir(parents=True)
    (device / "driver").symlink_to(driver)
    monkeypatch.setattr(list_ports, "comports", lambda: PORTS)
    assert [each.driver for each in serial_ports()] == ["", "ftdi_sio", ""]


def test_interfaces_of_the_system_are_listed_with_their_bit_rate_those_that_are_down_too(monkeypatch, system):
    for name, kind, flags in (("can0", "280", "0x40081"), ("can1", "280", "0x40080"), ("eth0", "1", "0x1003")):
        folder = system / "net" / name
        folder.mkdir(parents=True)
        (folder / "type").write_text(f"{kind}\n")
        (folder / "flags").write_text(f"{flags}\n")
    answer = json.dumps([{"linkinfo": {"info_kind": "can", "info_data": {"bittiming": {"bitrate": 250_000}}}}])
    monkeypatch.setattr(plugged, "_ip_text", lambda name: answer if name == "can0" else "")
    monkeypatch.setattr(can, "detect_available_configs", lambda names, timeout: [])
    monkeypatch.setattr(list_ports, "comports", list)
    assert can_adapters() == [
        Plugged("socketcan:can0", bit_rate=250_000),
        Plugged("socketcan:can1", is_up=False),
    ]


@pytest.mark.parametrize("text", ["", "[]", "{}", "not json", '[{"linkinfo": {"info_kind": "vcan"}}]', "[" * 100_000])
def test_what_names_no_bit_rate_has_none(text):
    assert bit_rate_in(text) is None


def test_can_adapters_are_named_as_the_option_takes_them_and_serial_ones_may_speak_slcan(monkeypatch):
    asked = []

    def detected(names, timeout):
        asked.extend(names)
        return [
            {"interface": "pcan", "channel": "P1", "device_name": "USB"},
        ]

    monkeypatch.setattr(can, "detect_available_configs", detected)
    monkeypatch.setattr(list_ports, "comports", lambda: PORTS)
    assert can_adapters() == [
        Plugged("pcan:P1", "USB", driver="pcan"),
        Plugged("slcan:/dev/ttyUSB1", "FT232R", "0403:6001"),
        Plugged("slcan:/dev/ttyACM0", usb_id="16D0"),
    ]
    for found in can_adapters():
        parse_bus(found.url)
    assert not {"virtual", "udp_multicast", "serial"} & set(asked), "those are no adapters of this machine"
