"""What tests of every kind share: frames of a made-up master, and the real service as a process."""

import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import httpx
import pytest

START_S = 30.0


@dataclass
class Service:
    """`voltwall serve` as a process of its own."""

    data: Path
    arguments: list[str]
    environment: dict[str, str] = field(default_factory=dict)
    process: subprocess.Popen[str] | None = None
    base_url: str = ""
    lines: list[str] = field(default_factory=list)
    reader: threading.Thread | None = None

    def start(self) -> "Service":
        """Start and wait for the line that names the address."""
        self.lines = []
        ready = threading.Event()
        self.process = subprocess.Popen(
            [sys.executable, "-m", "app.cli", "serve", "--port", "0", "--data", str(self.data), *self.arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=os.environ | {"PYTHONUNBUFFERED": "1"} | self.environment,
        )

        def read(process: subprocess.Popen[str]) -> None:
            with process.stdout:
                for line in process.stdout:
                    self.lines.append(line.rstrip())
                    if match := re.search(r"Voltwall: (http://\S+)", line):
                        self.base_url = match[1]
                        ready.set()
            ready.set()

        self.reader = threading.Thread(target=read, args=(self.process,), daemon=True)
        self.reader.start()
        assert ready.wait(START_S), "\n".join(self.lines)
        assert self.base_url, "\n".join(self.lines)
        return self

    def client(self, **options) -> httpx.Client:
        """An HTTP client of /api/v1."""
        return httpx.Client(base_url=self.base_url + "/api/v1", timeout=20, **options)

    def kill(self) -> None:
        """SIGKILL, as a power cut would."""
        self.process.send_signal(signal.SIGKILL)
        self.process.wait(10)
        self.reader.join(10)

    def stop(self) -> int:
        """SIGTERM and wait; the exit code."""
        if self.process.poll() is None:
            self.process.terminate()
        try:
            return self.process.wait(20)
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise
        finally:
            self.reader.join(10)

    def wait_for(self, condition: Callable[[dict], object], seconds: float = 20.0) -> dict:
        """Read snapshots off the websocket until one fulfils a condition; returns it."""
        import json
        import time

        from websockets.sync.client import connect

        deadline = time.monotonic() + seconds
        last: dict = {}
        with connect(self.base_url.replace("http", "ws") + "/api/v1/live", max_size=1 << 22) as socket:
            while (left := deadline - time.monotonic()) > 0:
                try:
                    last = json.loads(socket.recv(timeout=left))
                except TimeoutError:
                    break
                if condition(last):
                    return last
        summary = {name: last.get(name) for name in ("accumulator", "links", "master", "alarms", "age")}
        raise AssertionError(f"not within {seconds} s; last: {summary}")


@pytest.fixture
def make_service(tmp_path: Path) -> Iterator[Callable[..., Service]]:
    """Start services that are stopped at the end."""
    made: list[Service] = []

    def make(*arguments: str, data: Path | None = None, start: bool = True, **environment: str) -> Service:
        service = Service(data or tmp_path / "data", list(arguments), environment)
        made.append(service)
        return service.start() if start else service

    yield make
    for service in made:
        if service.process is not None and service.process.poll() is None:
            service.kill()


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """One service on the simulated accumulator for all tests of a module; it delivers snapshots already."""
    running = Service(tmp_path_factory.mktemp("service") / "data", ["--seed", "1"]).start()
    running.wait_for(lambda s: s["accumulator"]["loaded_cells"] == 96 and s["links"]["can"]["state"] == "live")
    yield running
    running.stop()
