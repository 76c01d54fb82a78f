"""The service under systemd's watchdog: ready, alive, stopping."""

import socket
import sys

import pytest

from tests.service_process import START_S, Service

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="systemd is on Linux alone")


def test_systemd_is_told_of_start_life_and_end(tmp_path):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(str(tmp_path / "notify"))
        systemd.settimeout(START_S)
        environment = {"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "300000"}
        service = Service(tmp_path / "data", ["--serial", str(tmp_path / "no-port")], environment).start()
        assert systemd.recv(100) == b"READY=1"
        assert [systemd.recv(100) for _ in range(3)] == [b"WATCHDOG=1"] * 3, "a car that is off is no stall"
        service.stop()
        told = systemd.recv(100)
        while told == b"WATCHDOG=1":
            told = systemd.recv(100)
        assert told == b"STOPPING=1"
