"""Thousands of connections that begin TLS and send nothing, or not enough, cost little memory, and it comes back."""

import json
import subprocess
import sys
import time
from pathlib import Path

import pytest
from websockets.sync.client import connect

from tests.campaign import campaign, of_size, report_figure
from tests.service_process import until
from tests.tls_clients import client_hello, trusting_all

COUNT = of_size(300, 1000, 5000)
ADDRESSES = 8
PEAK_MB = 60.0
KEPT_MB = 16.0  # with what the service itself grows by meanwhile
ROOT = Path(__file__).parents[2]
HELLO = client_hello()

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="asks Linux for the memory, and for more addresses")


@pytest.fixture(scope="module")
def pit(make_module_service):
    service = make_module_service("--tls")
    with connected(service) as stream:
        while json.loads(stream.recv())["links"]["rs232"]["state"] != "live":
            pass
    return service


def connected(service):
    return connect(f"{service.base_url.replace('http', 'ws')}/api/v1/live", ssl=trusting_all(), max_size=1 << 22)


def memory_mb(service, name):
    status = Path(f"/proc/{service.process.pid}/status").read_text()
    return int(status.partition(f"{name}:")[2].split()[0]) / 1024


@campaign(120, 240, 300)
@pytest.mark.parametrize(
    "first", [b"", HELLO[:1], HELLO[: len(HELLO) // 2], HELLO], ids=["nothing", "byte", "half", "hello"]
)
def test_silent_handshakes_cost_little_and_give_it_back(pit, first, request):
    Path(f"/proc/{pit.process.pid}/clear_refs").write_text("5")  # the peak begins here
    before_mb = memory_mb(pit, "VmRSS")
    host, _, port = pit.base_url.removeprefix("https://").partition(":")
    command = [sys.executable, "-m", "tests.tls_clients", host, port, str(COUNT), str(ADDRESSES), first.hex()]
    began_s = time.monotonic()
    with (
        connected(pit) as stream,
        pit.client(verify=False) as client,
        subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as clients,
    ):
        frames = json.loads(stream.recv(timeout=20))["links"]["rs232"]["frames"]
        assert int(clients.stdout.readline()) == COUNT
        took_s = time.monotonic() - began_s
        asked_s = time.monotonic()
        assert client.get("health").json()["status"] != "failing"
        answered_s = time.monotonic() - asked_s
        while json.loads(stream.recv(timeout=20))["links"]["rs232"]["frames"] <= frames:
            pass
        peak_mb = memory_mb(pit, "VmHWM") - before_mb
        clients.stdin.close()
    assert peak_mb < PEAK_MB
    until(lambda: memory_mb(pit, "VmRSS") < before_mb + KEPT_MB)
    kept_mb = memory_mb(pit, "VmRSS") - before_mb
    report_figure(
        f"{COUNT} handshakes with {request.node.callspec.id} in {took_s:.0f} s: peak {peak_mb:+.0f} MB, "
        f"then {kept_mb:+.0f} MB; health after {answered_s:.2f} s, stream live"
    )
