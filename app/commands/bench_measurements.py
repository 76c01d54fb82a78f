"""Measurements of `voltwall bench`: filter and chain in this process; the running service, as its clients see it."""

import json
import os
import re
import statistics
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

import numpy as np
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from app.clock import Clock
from app.estimation.cell_model.cell_file import load_cell
from app.estimation.filters.estimators import make_estimator
from app.estimation.filters.filter_names import FILTERS
from app.live.pipeline import Pipeline
from app.sessions.catalogue import Catalogue
from app.sessions.reading.reader import SessionFile
from app.sessions.recording.recorder import Recorder
from app.sessions.storage.files import size_on_disk
from app.sessions.worker import command_of
from app.sources.items import SerialItem
from app.sources.master.source import MasterSource
from firmware_protocol.config_image import default_image
from firmware_protocol.framing import LINE_BYTES_PER_S, FrameDecoder, encode_frame
from firmware_protocol.memory_map import FIELDS, MASTER_SIZE, N_CELLS
from firmware_protocol.messages import Data, MessageType, Window
from firmware_protocol.schedule import FAST_WINDOWS

CHIP_US = 290.0  # the cell monitor's conversion of a pack
PASSES = 3000
START_S = 30.0
Passed = Callable[[float], None]  # gets how many seconds of the measurement are over
Row = tuple[str, str, str]  # what, figure, method
FIRST_S = 3.0  # start of a session after which every table and series has begun
_CLOCK_HZ = os.sysconf("SC_CLK_TCK") if hasattr(os, "sysconf") else 100


def _median_us(work: Callable[[int], Any], n: int) -> float:
    """Median time of one call [us], the first tenth left out as warm-up."""
    times = []
    for i in range(n):
        started = time.perf_counter_ns()
        work(i)
        times.append(time.perf_counter_ns() - started)
    return statistics.median(times[n // 10 :]) / 1000


def filter_pass_us(filter_name: str, cell_name: str) -> float:
    """Median time of one `step` over 96 cells [us], current and voltages changing."""
    rng = np.random.default_rng(1)
    estimator = make_estimator(filter_name, load_cell(cell_name), N_CELLS)
    voltages_v = list(rng.uniform(3.5, 3.9, (64, N_CELLS)))
    currents_a = rng.uniform(-20, 100, 64).tolist()
    temperatures_degc = np.full(N_CELLS, 30.0)
    estimator.start(voltages_v[0], temperatures_degc, 0.0)
    return _median_us(lambda i: estimator.step(0.1, currents_a[i % 64], voltages_v[i % 64], temperatures_degc), PASSES)


def example_image(step: int = 0) -> bytearray:
    """A struct full of plausible values, a little different at each step."""
    image = bytearray(MASTER_SIZE)
    image[:420] = default_image()
    FIELDS["v"].pack_into(image, tuple(36000 + (i * 37 + step * 11) % 900 for i in range(N_CELLS)))
    FIELDS["t"].pack_into(image, tuple(25 + i % 7 for i in range(N_CELLS)))
    FIELDS["i_fs"].pack_into(image, (2000 + step % 500,))
    FIELDS["status.flags"].pack_into(image, (0b100000001,))
    FIELDS["v_tot"].pack_into(image, (34900,))
    FIELDS["soc"].pack_into(image, (8000,))
    return image


def fast_frame(step: int, uptime_ms: int) -> bytes:
    """One telemetry frame as it stands on the line, both delimiters included."""
    image = example_image(step)
    windows = tuple(Window(offset, bytes(image[offset : offset + length])) for offset, length in FAST_WINDOWS)
    body = Data(windows).to_body()
    return encode_frame(MessageType.DATA, step & 0xFF, uptime_ms, body)


def chain_rates(filter_name: str, cell_name: str) -> tuple[float, float]:
    """Return (frames a second decoded from bytes, frames a second through decoder, shadow, filter and watch)."""
    frames = [fast_frame(i, 1000 + 100 * i) for i in range(2000)]
    decoder = FrameDecoder()
    decode_us = _median_us(lambda i: decoder.feed(frames[i]), len(frames))
    cell = load_cell(cell_name)
    pipeline = Pipeline(
        MasterSource("serial"),
        lambda: make_estimator(filter_name, cell, N_CELLS),
        filter_name=filter_name,
        cell_name=cell_name,
    )
    decoder = FrameDecoder()

    def whole(i: int) -> None:
        for frame in decoder.feed(frames[i]):
            pipeline.feed(SerialItem(i * 100_000_000, i * 100_000_000, frame))

    return 1e6 / decode_us, 1e6 / _median_us(whole, len(frames))


def numerics(cell: str, passed: Passed) -> list[Row]:
    """Time the filters and the chain in this process."""
    rows: list[Row] = []
    for name in FILTERS:
        pass_us = filter_pass_us(name, cell)
        method = f"median of 3000 steps; the chip needs {CHIP_US:g} us ({CHIP_US / pass_us:.0f} times longer)"
        rows.append((f"filter, one pass of 96 cells, {name}", f"{pass_us:.1f} us", method))
        passed(1.0)
    decoded, whole = chain_rates("fused", cell)
    passed(1.0)
    line = "the line carries 28"
    rows.append(("decoder: bytes to checked frames", f"{decoded:,.0f} /s", f"median of 2000; {line}"))
    rows.append(("decoder, shadow, filter, alarms", f"{whole:,.0f} /s", f"the same frames to snapshots; {line}"))
    return rows


def cpu_s(pid: int) -> float | None:
    """Processor time used so far [s]."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return None
    return (int(fields[11]) + int(fields[12])) / _CLOCK_HZ


def resident_mb(pid: int) -> float | None:
    """Resident memory [MB]."""
    try:
        for line in Path(f"/proc/{pid}/status").read_text().splitlines():
            if line.startswith("VmRSS:"):
                return int(line.split()[1]) / 1000
    except OSError:
        return None
    return None


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
    """Arrival times of snapshots at a websocket client, by the master's uptime."""

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


def at_line_limit(seconds: float, passed: Passed) -> list[Row]:
    """Send telemetry frames back to back at 115200 8E1's rate through a pseudo-terminal.

    `passed` gets how long each of them took.

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
    p50_ms, p99_ms = (latencies[int(len(latencies) * share)] for share in (0.5, 0.99))
    sent, bad = f"{step} frames back to back through a pseudo-terminal", link["crc_errors"] + link["resyncs"]
    return [
        ("frames at the line's limit", f"{step / took:.1f} /s", sent),
        ("frames lost", f"{step - link['frames']}", f"sequence gaps {link['lost']}, bad {bad}"),
        ("last byte to websocket client, p50", f"{p50_ms:.1f} ms", "from the last byte's write, same clock"),
        ("last byte to websocket client, p99", f"{p99_ms:.1f} ms", "same run"),
        ("CPU at the line's limit", _percent(cpu_before, cpu_after, took), "service process, recording, one client"),
        ("resident memory at the line's limit", _megabytes(memory), "same run"),
    ]


def _percent(before_s: float | None, after_s: float | None, took_s: float) -> str:
    if before_s is None or after_s is None:
        return "unknown"
    return f"{100 * (after_s - before_s) / took_s:.1f} % of a core"


def _megabytes(value: float | None) -> str:
    return "unknown" if value is None else f"{value:.0f} MB"


def _drain(descriptor: int) -> None:
    """Read what the service sends, so that its writes never block."""

    def read() -> None:
        try:
            while os.read(descriptor, 4096):
                pass
        except OSError:
            return

    threading.Thread(target=read, daemon=True).start()


def simulated(seconds: float, passed: Passed) -> list[Row]:
    """Start-up to the first snapshot with 96 cells, then CPU, memory and file growth with one client connected.

    The service is on the simulated accumulator, as `make run` starts it. `passed` gets every second or less of the
    `seconds`.
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
        service.stop()
        growth = f"{_mb_per_hour(service.data):.0f} MB/h"
    cpu = _percent(cpu_before, cpu_after, took)
    return [
        ("start-up to 96 live cells", f"{start_s:.2f} s", "process start to snapshot, simulator included"),
        ("CPU at 10 Hz", cpu, f"service process, recording, one client, {seconds:g} s"),
        ("resident memory", _megabytes(memory), "service process, same run"),
        ("session file", growth, f"growth over {seconds:g} s at {link['rate_hz']:.1f} Hz"),
    ]


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
