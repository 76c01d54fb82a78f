"""What systemd is told, over a real datagram socket."""

import asyncio
import os
import socket
import sys

import pytest

from app.service.health.watchdog import keep_alive, notify, period_s
from app.words import Message

pytestmark = pytest.mark.skipif(not hasattr(socket, "AF_UNIX"), reason="systemd is on Linux alone")


@pytest.fixture
def systemd(tmp_path):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(tmp_path / "notify"))
        listener.settimeout(10)
        yield listener


@pytest.fixture
def environment(systemd):
    return {"NOTIFY_SOCKET": systemd.getsockname(), "WATCHDOG_USEC": "30000", "WATCHDOG_PID": str(os.getpid())}


def test_a_message_arrives_as_it_is(systemd, environment):
    notify("READY=1", environment)
    assert systemd.recv(100) == b"READY=1"


@pytest.mark.skipif(sys.platform != "linux", reason="abstract sockets are Linux's")
def test_a_socket_without_a_file_is_reached_too():
    name = f"voltwall-test-{os.getpid()}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind("\0" + name)
        listener.settimeout(10)
        notify("STOPPING=1", {"NOTIFY_SOCKET": "@" + name})
        assert listener.recv(100) == b"STOPPING=1"


@pytest.mark.parametrize("environment", [{}, {"NOTIFY_SOCKET": "/nowhere/at/all"}])
def test_without_a_listener_nothing_happens(environment):
    notify("READY=1", environment)


def test_signs_of_life_come_three_times_in_the_watchdogs_time(environment):
    assert period_s(environment) == pytest.approx(0.01)


@pytest.mark.parametrize(
    "changed", [{"WATCHDOG_USEC": ""}, {"WATCHDOG_USEC": "0"}, {"WATCHDOG_USEC": "soon"}, {"WATCHDOG_PID": "1"}]
)
def test_who_is_not_watched_sends_none(environment, changed):
    assert period_s(environment | changed) is None
    asyncio.run(asyncio.wait_for(keep_alive(list, environment | changed), 10))


def test_signs_of_life_stop_while_something_stands_still_and_come_back(systemd, environment, caplog):
    stands_still = [Message("disk-silent", time=30.0)]
    answers = iter([[], [], stands_still, stands_still, []])
    ends = asyncio.CancelledError()

    def stalls():
        try:
            return next(answers)
        except StopIteration:
            raise ends from None

    with pytest.raises(asyncio.CancelledError):
        asyncio.run(keep_alive(stalls, environment))
    told = [systemd.recv(200) for _ in range(5)]
    assert told[:2] + told[4:] == [b"WATCHDOG=1"] * 3
    assert told[2].startswith(b"STATUS=the disk has not accepted data")
    assert caplog.text.count("no sign of life") == 1
