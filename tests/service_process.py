"""`voltwall serve` as a process, and how a test waits for what it shows."""

import json
import os
import re
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing.process import BaseProcess
from pathlib import Path

import httpx
from websockets.sync.client import connect

from tests.forked import start_program

# on a machine that does ten other things too
START_S = 60.0
WAIT_S = 45.0
END_S = 40.0
LOOK_S = 0.02
N_CELLS = 96
NO_CAR = "socket://127.0.0.1:9"  # a line at which nobody is: a service on recorded sessions has nothing else to do


def until(condition: Callable[[], object], seconds: float = WAIT_S) -> None:
    """Wait for what is seen by looking only."""
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, f"not within {seconds} s"
        time.sleep(LOOK_S)


@dataclass
class Service:
    """`voltwall serve` as a process of its own."""

    data: Path
    arguments: list[str]
    environment: dict[str, str] = field(default_factory=dict)
    process: BaseProcess | None = None
    base_url: str = ""
    lines: list[str] = field(default_factory=list)
    reader: threading.Thread | None = None

    def start(self) -> "Service":
        """Start and wait for the line that names the address."""
        self.lines = []
        ready = threading.Event()
        arguments = ["serve", "--port", "0", "--data", str(self.data), *self.arguments]
        self.process, output = start_program(
            "app.cli", arguments, os.environ | {"VOLTWALL_SEASON": "0"} | self.environment
        )

        def read() -> None:
            with output:
                for line in output:
                    self.lines.append(line.rstrip())
                    if match := re.search(r"Voltwall: (https?://\S+)", line):
                        self.base_url = match[1]
                        ready.set()
            ready.set()

        self.reader = threading.Thread(target=read, daemon=True)
        self.reader.start()
        assert ready.wait(START_S), "\n".join(self.lines)
        assert self.base_url, "\n".join(self.lines)
        return self

    def choose(self, **connections: str) -> None:
        """Choose what is read, and wait until the service has started again with it."""
        with self.client() as client:
            answer = client.put("/setup", json=connections)
            assert answer.status_code == 202, answer.text
            before = answer.json()["instance"]

            def is_again() -> bool:
                try:
                    return client.get("/setup").json()["instance"] != before
                except httpx.TransportError:  # it is starting
                    return False

            until(is_again)

    def client(self, **options) -> httpx.Client:
        """An HTTP client of /api/v1."""
        return httpx.Client(base_url=self.base_url + "/api/v1", timeout=WAIT_S, **options)

    def kill(self) -> None:
        """SIGKILL, as a power cut would."""
        self.process.kill()
        self.process.join(END_S)
        self.reader.join(END_S)

    def stop(self) -> int:
        """SIGTERM and wait; the exit code."""
        self.process.terminate()
        self.process.join(END_S)
        code = self.process.exitcode
        if code is None:
            self.process.kill()
            raise AssertionError(f"it did not end within {END_S} s")
        self.reader.join(END_S)
        return code

    @property
    def is_running(self) -> bool:
        """Whether its process lives."""
        return self.process is not None and self.process.is_alive()

    def wait_for(self, condition: Callable[[dict], object], seconds: float = WAIT_S) -> dict:
        """Read snapshots off the websocket until one fulfils a condition; returns it."""
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
