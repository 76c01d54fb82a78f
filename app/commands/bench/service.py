"""The running service, measured from outside: a pseudo-terminal at one end, a websocket client at the other."""

import json
import os
import re
import subprocess
import tempfile
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from app.clock import Clock
from app.commands.bench.numerics import fast_frame
from app.commands.bench.process import cpu_s, resident_mb
from app.sessions.catalogue import Catalogue
from app.sessions.reading.reader import SessionFile
from app.sessions.recording.recorder import Recorder
from app.sessions.storage.files import size_on_disk
from app.sessions.worker import command_of
from firmware_protocol.framing import LINE_BYTES_PER_S

START_S = 30.0
Passed = Callable[[float], None]  # told how many seconds of the measurement are over
FIRST_S = 3.0  # of a session: every table and series has begun


@dataclass
class Served:
    """A `voltwall serve` process."""

    process: subprocess.Popen[str]
    url: str
    data: Path

    def snapshot(self) -> dict[str, Any]:
        """GET snapshot."""
        with urllib.request.urlopen(self.url + "/api/v1/snapshot", timeout=10) as answer:
            body: dict[str, Any] = json.load(answer)
        return body

    def stop(self) -> None:
        """End the service in order: what it recorded is closed."""
        self.process.terminate()
        self.process.wait(20)


@contextmanager
def served(*arguments: str) -> Iterator[Served]:
    """Start the service with its data in a temporary folder; stop it at the end."""
    with tempfile.TemporaryDirectory(prefix="voltwall-bench-") as folder:
        process = subprocess.Popen(
            command_of("app.cli", "serve", "--port", "0", "--data", folder, "--log-level", "error", *arguments),
            stdout=subprocess.PIPE,
            text=True,
        )
        service = Served(process, "", Path(folder))
        try:
            service.url = _url_of(process)
            yield service
        finally:
            service.stop()


def _url_of(process: subprocess.Popen[str]) -> str:
    for line in process.stdout or ():
        if match := re.search(r"Voltwall: (http://\S+)", line):
            threading.Thread(target=lambda: [None for _ in process.stdout or ()], daemon=True).start()
            return match[1]
    raise RuntimeError("the service did not start")


@dataclass
class Arrivals:
    """When snapshots of which master uptime reached a websocket client."""

    url: str
    at_ns: dict[int, int] = field(default_factory=dict)
    ready: threading.Event = field(default_factory=threading.Event)

    def start(self) -> None:
        """Connect in a thread of its own."""
        threading.Thread(target=self._run, daemon=True).start()
        self.ready.wait(10)

    def _run(self) -> None:
        with connect(self.url.replace("http", "ws", 1) + "/api/v1/live", max_size=1 << 22) as socket:
            self.ready.set()
            try:
                while True:
                    text = socket.recv()
                    now_ns = time.monotonic_ns()
                    uptime_s = json.loads(text)["uptime_s"]
                    if uptime_s is not None:
                        self.at_ns.setdefault(round(uptime_s * 1000), now_ns)
            except ConnectionClosed:
                return


@dataclass(frozen=True)
class LineResult:
    """Frames at the line's limit."""

    seconds: float
    sent: int
    received: int
    lost: int
    bad: int
    p50_ms: float
    p99_ms: float
    cpu_percent: float | None
    resident_mb: float | None


def at_line_limit(seconds: float, passed: Passed) -> LineResult:
    """Send telemetry frames back to back at 115200 8E1's rate through a pseudo-terminal.

    `passed` is told how long each of them took.

    Latency: from the write of a frame's last byte to the arrival of the snapshot with its uptime at the client.
    """
    master, slave = os.openpty()
    import tty

    tty.setraw(master)
    path = os.ttyname(slave)
    sent_ns: dict[int, int] = {}
    with served("--serial", path) as service:
        arrivals = Arrivals(service.url)
        arrivals.start()
        _drain(master)
        time.sleep(1.0)
        while service.snapshot()["links"]["rs232"]["state"] == "connecting":
            time.sleep(0.1)
        cpu_before, started = cpu_s(service.process.pid), time.monotonic()
        due = started
        step = 0
        while time.monotonic() - started < seconds:
            uptime_ms = 1000 + 40 * step
            frame = fast_frame(step, uptime_ms)
            due += len(frame) / LINE_BYTES_PER_S
            if (wait := due - time.monotonic()) > 0:
                time.sleep(wait)
            os.write(master, frame)
            sent_ns[uptime_ms] = time.monotonic_ns()
            step += 1
            passed(len(frame) / LINE_BYTES_PER_S)
        took = time.monotonic() - started
        time.sleep(0.5)
        cpu_after = cpu_s(service.process.pid)
        link = service.snapshot()["links"]["rs232"]
        memory = resident_mb(service.process.pid)
    os.close(slave)
    os.close(master)
    latencies = sorted((arrivals.at_ns[u] - t) / 1e6 for u, t in sent_ns.items() if u in arrivals.at_ns)
    return LineResult(
        took,
        step,
        link["frames"],
        link["lost"],
        link["crc_errors"] + link["resyncs"],
        latencies[len(latencies) // 2],
        latencies[int(len(latencies) * 0.99)],
        None if cpu_before is None or cpu_after is None else 100 * (cpu_after - cpu_before) / took,
        memory,
    )


def _drain(descriptor: int) -> None:
    """Read what the service sends, so that its writes never block."""

    def read() -> None:
        try:
            while os.read(descriptor, 4096):
                pass
        except OSError:
            return

    threading.Thread(target=read, daemon=True).start()


@dataclass(frozen=True)
class SimulatedResult:
    """The service on the simulated accumulator, as `make run` starts it."""

    start_s: float
    cpu_percent: float | None
    resident_mb: float | None
    session_mb_per_hour: float
    rate_hz: float
    lost: int


def simulated(seconds: float, passed: Passed) -> SimulatedResult:
    """Start-up to the first snapshot with 96 cells, then CPU, memory and file growth with one client connected.

    `passed` is told of every second or less of the `seconds`.
    """
    started = time.monotonic()
    with served() as service:
        while not _is_live(service) and time.monotonic() - started < START_S:
            time.sleep(0.02)
        start_s = time.monotonic() - started
        Arrivals(service.url).start()
        time.sleep(2.0)
        pid = service.process.pid
        cpu_before, begun = cpu_s(pid), time.monotonic()
        while (left_s := begun + seconds - time.monotonic()) > 0:
            time.sleep(min(left_s, 1.0))
            passed(min(left_s, 1.0))
        took = time.monotonic() - begun
        cpu_after, memory = cpu_s(pid), resident_mb(pid)
        link = service.snapshot()["links"]["rs232"]
        cpu = None if cpu_before is None or cpu_after is None else 100 * (cpu_after - cpu_before) / took
        service.stop()
        return SimulatedResult(start_s, cpu, memory, _mb_per_hour(service.data), link["rate_hz"], link["lost"])


def _is_live(service: Served) -> bool:
    try:
        return bool(service.snapshot()["accumulator"]["loaded_cells"] == 96)
    except OSError:
        return False


def _mb_per_hour(data: Path) -> float:
    """Growth of the session once closed: before, its log holds every page as often as it was written.

    What a session of its first seconds takes, mostly tables, is not growth.
    """
    (info,) = Catalogue(data / "sessions").list()
    with SessionFile(info.path) as session, tempfile.TemporaryDirectory() as folder:
        recorder = Recorder(Path(folder), Clock(), version="bench")
        first = recorder.start()
        for frame in session.frames(None, info.started_wall_ns / 1e9 + FIRST_S):
            recorder.frame(frame.t_mono_ns, frame.t_wall_ns, frame.link, frame.raw, frame.ok)
        recorder.close()
        grown = info.size_bytes - size_on_disk(first.path)
    return grown / 1e6 / (info.duration_s - FIRST_S) * 3600
