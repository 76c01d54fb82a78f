"""Cost of readers of the live stream: `python -m benchmarks.readers [--readers 20,200,1000]`.

`voltwall serve` with its simulated car, and one process that holds all readers on plain sockets, so that they cost
little. Latency: from the arrival of a frame at the service (`time` of the snapshot) to the last byte of the message at
the reader, on one clock. Processor and memory are those of the service's process; "a message" is what readers add to
the time without any.
"""

import argparse
import json
import os
import re
import select
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np

from app.commands.bench_measurements import cpu_s, resident_mb

ROOT = Path(__file__).resolve().parent.parent
WARM_S = 8.0  # for the simulated car, the filter and the first predictions
LEFT_S = 5.0  # after all have left
JOIN_S = 20.0
HEAD = 160  # bytes of a snapshot that tell its time
TIME = re.compile(rb'"time":([0-9.]+)')
HANDSHAKE = (
    "GET /api/v1/live?rate={rate:g} HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
)


@dataclass
class Reader:
    """One websocket: what of its message has come."""

    socket: socket.socket
    is_open: bool = False
    pending: bytearray = field(default_factory=bytearray)
    left: int = 0  # bytes of the message that are still to come
    time_s: float = 0.0

    def take(self, data: memoryview, now_s: float, late_s: list[float]) -> int:
        """Count the messages that end in `data`, and how late they are."""
        if not self.is_open:
            self.pending += data
            head, end, rest = bytes(self.pending).partition(b"\r\n\r\n")
            if not end:
                return 0
            if b" 101 " not in head.split(b"\r\n", 1)[0]:
                raise RuntimeError(head.decode())
            self.is_open, self.pending = True, bytearray()
            data = memoryview(rest)
        n = 0
        while len(data):
            if self.left:
                taken = min(self.left, len(data))
                self.left -= taken
                data = data[taken:]
                if not self.left and self.time_s:
                    late_s.append(now_s - self.time_s)
                    n += 1
                continue
            self.pending += data[:HEAD]
            data = data[HEAD:]
            began = self._begin()
            if began is None:
                continue
            size, self.time_s = began
            have = len(self.pending)
            if have <= size:
                self.left, self.pending = size - have, bytearray()
                if not self.left and self.time_s:
                    late_s.append(now_s - self.time_s)
                    n += 1
            else:  # a short frame, and more behind it
                data = memoryview(bytes(self.pending[size:]) + bytes(data))
                self.pending = bytearray()
        return n

    def _begin(self) -> tuple[int, float] | None:
        """Return size and time of the message that begins; None until enough of it is there."""
        got = self.pending
        if len(got) < 4:
            return None
        length, at = got[1] & 0x7F, 2
        if length == 126:
            length, at = int.from_bytes(got[2:4], "big"), 4
        elif length == 127:
            if len(got) < 10:
                return None
            length, at = int.from_bytes(got[2:10], "big"), 10
        size = at + length
        if got[0] & 0x0F != 1:
            if got[0] & 0x0F == 9:
                self.socket.send(b"\x8a" + bytes([0x80 | length]) + bytes(4) + bytes(got[at:size]))
            return (size, 0.0) if len(got) >= size else None
        if len(got) < min(HEAD, size):
            return None
        body = bytes(got[at:])
        match = TIME.search(body)
        return size, float(match[1]) if match else 0.0


def read(url: str, n: int, rate: float, seconds: float) -> dict[str, float]:
    """Hold `n` readers for so long; print when all are there; return what came."""
    address = urlsplit(url)
    text = HANDSHAKE.format(rate=rate, host=address.netloc).encode()
    readers: dict[int, Reader] = {}
    poll = select.epoll()
    buffer = memoryview(bytearray(1 << 18))
    late_s: list[float] = []
    taken = n_bytes = 0

    def turn(timeout_s: float) -> None:
        nonlocal taken, n_bytes
        for number, _ in poll.poll(timeout_s):
            reader = readers[number]
            size = reader.socket.recv_into(buffer)
            if not size:
                raise RuntimeError("a reader was closed")
            n_bytes += size
            taken += reader.take(buffer[:size], time.time(), late_s)

    for i in range(n):
        made = socket.create_connection((address.hostname or "", address.port or 80), timeout=JOIN_S)
        made.sendall(text)
        readers[made.fileno()] = Reader(made)
        poll.register(made.fileno(), select.EPOLLIN)
        if i % 16 == 15:
            turn(0.05)
    until = time.monotonic() + JOIN_S
    while not all(reader.is_open for reader in readers.values()) and time.monotonic() < until:
        turn(0.1)
    until = time.monotonic() + 2.0  # the first ones come at once, all together
    while time.monotonic() < until:
        turn(0.1)
    late_s.clear()
    taken = n_bytes = 0
    print("there", flush=True)
    began = time.monotonic()
    while time.monotonic() - began < seconds:
        turn(0.1)
    took_s = time.monotonic() - began
    late = np.array(late_s or [np.nan]) * 1e3
    print("done", flush=True)
    return {
        "messages": taken,
        "a_second": taken / took_s / n,
        "kb": n_bytes / max(taken, 1) / 1e3,
        "p50": float(np.quantile(late, 0.5)),
        "p99": float(np.quantile(late, 0.99)),
        "max": float(late.max()),
    }


@contextmanager
def served() -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Serve the simulated car; yield its process and address."""
    with tempfile.TemporaryDirectory(prefix="voltwall-bench-") as folder:
        process = subprocess.Popen(
            [sys.executable, "-m", "app.cli", "serve", "--port", "0", "--data", folder, "--log-level", "error"],
            cwd=ROOT,
            env=os.environ | {"VOLTWALL_SEASON": "0"},
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            match = next(filter(None, (re.search(r"Voltwall: (http://\S+)", line) for line in process.stdout or ())))
            yield process, match[1]
        finally:
            process.send_signal(signal.SIGTERM)
            process.wait(30)


def measure(n: int, rate: float, seconds: float) -> dict[str, float]:
    """Serve, count what the service takes without readers, then with them, then after they left."""
    with served() as (process, url):
        pid = process.pid
        time.sleep(WARM_S)
        _hold(url, 20, rate, 1.0)  # what is imported and cached for the first reader stays
        idle_before, idle_began = cpu_s(pid) or 0.0, time.monotonic()
        time.sleep(seconds / 2)
        alone, memory = ((cpu_s(pid) or 0.0) - idle_before) / (time.monotonic() - idle_began), resident_mb(pid) or 0.0
        client = _start(url, n, rate, seconds)
        before, began = cpu_s(pid) or 0.0, time.monotonic()
        _line(client, "done")
        share = ((cpu_s(pid) or 0.0) - before) / (time.monotonic() - began)
        full = resident_mb(pid) or 0.0
        figures = json.loads(client.communicate(timeout=60)[0])
        time.sleep(LEFT_S)
        return {
            "readers": n,
            "a second each": figures["a_second"],
            "kB": figures["kb"],
            "p50 ms": figures["p50"],
            "p99 ms": figures["p99"],
            "max ms": figures["max"],
            "core %": 100 * share,
            "us a message": 1e6 * (share - alone) / max(figures["a_second"] * n, 1e-9),
            "MB before": memory,
            "MB with": full,
            "MB after": resident_mb(pid) or 0.0,
        }


def _start(url: str, n: int, rate: float, seconds: float) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "benchmarks.readers", "--url", url, "--readers", str(n), "--rate", str(rate)]
    client = subprocess.Popen([*command, "--seconds", str(seconds)], cwd=ROOT, stdout=subprocess.PIPE, text=True)
    _line(client, "there")
    return client


def _hold(url: str, n: int, rate: float, seconds: float) -> None:
    _start(url, n, rate, seconds).communicate(timeout=60)
    time.sleep(1.0)


def _line(client: subprocess.Popen[str], wanted: str) -> None:
    for line in client.stdout or ():
        if line.strip() == wanted:
            return
    raise RuntimeError("the readers ended")


def main() -> None:
    """Measure each number of readers and print one table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--readers", default="20,200,1000")
    parser.add_argument("--rate", type=float, default=10.0)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--url", help=argparse.SUPPRESS)  # the readers' own process
    args = parser.parse_args()
    if args.url:
        print(json.dumps(read(args.url, int(args.readers), args.rate, args.seconds)))
        return
    for i, n in enumerate(args.readers.split(",")):
        figures = measure(int(n), args.rate, args.seconds)
        if i == 0:
            print("| " + " | ".join(figures) + " |\n|" + " ---: |" * len(figures))
        print("| " + " | ".join(f"{value:.3g}" for value in figures.values()) + " |", flush=True)


if __name__ == "__main__":
    main()
