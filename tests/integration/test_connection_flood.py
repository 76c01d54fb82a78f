"""More connections than the service has descriptors: all who ask are still answered, and the car is still recorded."""

import contextlib
import resource
import socket
import subprocess
import sys
from urllib.parse import urlsplit

import pytest

from tests.campaign import SIZE, campaign, report_figure
from tests.service_process import Service, until

DESCRIPTORS = 1024
SILENT = 1100
MOST_LINES = 200


@pytest.mark.skipif(SIZE == "sample" or sys.platform != "linux", reason="1,100 connections: in the campaign")
@campaign(60, 120, 120)
def test_more_silent_connections_than_descriptors(tmp_path):
    own = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(own[0], 2 * SILENT), own[1]))
    command = ["prlimit", f"--nofile={DESCRIPTORS}:{DESCRIPTORS}", sys.executable, "-m", "app.cli", "serve"]
    output = tmp_path / "output"
    with output.open("wb") as file:
        started = subprocess.Popen(
            [*command, "--port", "0", "--data", str(tmp_path / "data")], stdout=file, stderr=subprocess.STDOUT
        )
    service = Service(tmp_path, [])
    try:
        until(lambda: "Voltwall: http" in output.read_text())
        service.base_url = output.read_text().partition("Voltwall: ")[2].split()[0]
        service.wait_for(lambda snapshot: all(snapshot["links"][name]["state"] == "live" for name in ("rs232", "can")))
        address = urlsplit(service.base_url)
        with contextlib.ExitStack() as stack:
            for _ in range(SILENT):
                stack.enter_context(socket.create_connection((address.hostname, address.port), timeout=10))
            with service.client() as client:
                before = client.get("snapshot").json()["links"]["rs232"]["frames"]
                assert client.get("health").json()["status"] != "failing"  # a busy machine may leave predictions out
            after = service.wait_for(lambda snapshot: snapshot["links"]["rs232"]["frames"] > before)
            assert after["links"]["rs232"]["state"] == "live"
    finally:
        started.terminate()
        started.wait(30)
    lines = len(output.read_text().splitlines())
    assert lines < MOST_LINES
    report_figure(f"{SILENT} silent connections on {DESCRIPTORS} descriptors: answered, {lines} log lines")
