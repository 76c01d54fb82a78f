"""What a service writes to is full, or its terminal is closed: it starts all the same, and ends in order."""

import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import httpx
import pytest

from app.sessions.catalogue import Catalogue
from tests.service_process import END_S, START_S, until

PROJECT = Path(__file__).parents[2]
pytestmark = pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs Linux")


@pytest.fixture
def start(tmp_path):
    """Start a service on the simulated car, with its output somewhere; (process, client)."""
    running = []

    def start(output):
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        process = subprocess.Popen(
            [sys.executable, "-m", "app.cli", "serve", "--port", str(port), "--data", str(tmp_path)],
            cwd=PROJECT, env=os.environ | {"VOLTWALL_SEASON": "0"}, stdout=output, stderr=output,
        )  # fmt: skip
        client = httpx.Client(base_url=f"http://127.0.0.1:{port}/api/v1")
        running.append((process, client))

        def records():
            assert process.poll() is None, f"it ended with {process.returncode}"
            try:
                return client.get("/recorder").json()["state"] == "recording"
            except httpx.TransportError:
                return False

        until(records, START_S)
        return process

    yield start
    for process, client in running:
        client.close()
        if process.poll() is None:
            process.kill()
        process.wait(END_S)


def closed_sessions(folder):
    return [info.is_closed for info in Catalogue(folder / "sessions").list()]


def test_a_log_on_a_full_disk_stops_neither_start_nor_end(start, tmp_path):
    with Path("/dev/full").open("w") as full:
        process = start(full)
    process.send_signal(signal.SIGTERM)
    assert process.wait(END_S) in (0, -signal.SIGTERM)
    assert closed_sessions(tmp_path) == [True]


def test_a_terminal_that_is_closed_closes_the_session(start, tmp_path):
    process = start(subprocess.DEVNULL)
    process.send_signal(signal.SIGHUP)
    assert process.wait(END_S) == 0
    assert closed_sessions(tmp_path) == [True]
