"""What an import does to live values and recording: `python -m benchmarks.import_latency [--turns 5]`.

`voltwall serve` with its simulated car, in turns: for some seconds nothing, then as long one import of a CSV after
the other; what still runs then is waited for. Each turn gives a ratio, and the median of the ratios is told, so that
a machine that becomes slower or quicker is not in it. Latency: from the arrival of a frame at the service (`time` of
the snapshot) to the snapshot at a websocket client, on one clock. Recording: how long ago the newest frame in the
session's file arrived, looked at twenty times a second. Upload and inspection count as import. Wants a machine that
does nothing else: two cores; the machine's load is printed beside, and other programs' work is in the figures.
"""

import argparse
import json
import os
import sqlite3
import tempfile
import threading
import time
from collections import defaultdict
from contextlib import closing, suppress
from pathlib import Path

import httpx
import numpy as np
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from app.commands.bench.service import Served, served

N_CELLS = 96
ROW_BYTES = 7 * N_CELLS + 10
WARM_S = 10.0
LOOK_S = 0.05
ANSWER_S = 300.0
NONE, IMPORT, AFTER = "none", "import", "after"
MAPPING = {"profile": {"time": "t", "current": "I", "voltages": "Cell {n}"}}


def write_csv(path: Path, megabytes: float) -> None:
    """Write a log of cell voltages, ten rows a second."""
    rng = np.random.default_rng(1)
    with path.open("w") as file:
        file.write("t,I," + ",".join(f"Cell {i + 1}" for i in range(N_CELLS)) + "\n")
        for row in range(int(megabytes * 1e6 / ROW_BYTES)):
            voltages = rng.normal(3.7, 0.01, N_CELLS)
            file.write(f"{row / 10:.1f},12," + ",".join(f"{v:.4f}" for v in voltages) + "\n")


class Watch:
    """Two threads that note latency and how far the file is behind, by phase."""

    def __init__(self, service: Served) -> None:
        self.phase = ""
        self.late_s: dict[str, list[float]] = defaultdict(list)
        self.behind_s: dict[str, list[float]] = defaultdict(list)
        self._service = service
        self._is_over = threading.Event()
        self._threads = [threading.Thread(target=self._live), threading.Thread(target=self._file)]
        for thread in self._threads:
            thread.start()

    def end(self) -> None:
        """End the threads."""
        self._is_over.set()
        for thread in self._threads:
            thread.join()

    def _live(self) -> None:
        url = self._service.url.replace("http", "ws", 1) + "/api/v1/live"
        with suppress(ConnectionClosed), connect(url, max_size=1 << 22) as socket:
            while not self._is_over.is_set():
                text = socket.recv()
                self.late_s[self.phase].append(time.time() - json.loads(text)["time"])

    def _file(self) -> None:
        path = min((self._service.data / "sessions").glob("*.sqlite"))  # the one that is recorded; imports come later
        while not self._is_over.wait(LOOK_S):
            with suppress(sqlite3.Error), closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as file:
                ((t_ns,),) = file.execute("SELECT t_mono_ns FROM frames ORDER BY id DESC LIMIT 1")
                self.behind_s[self.phase].append(time.monotonic() - t_ns / 1e9)


def bring_in(client: httpx.Client, path: Path, watch: Watch, until_s: float) -> int:
    """Upload and import again and again until that time; return how many imports began.

    What is seen after it counts for neither: the last import may need longer.
    """
    n = 0
    while time.monotonic() < until_s:
        uploaded = client.post("/imports", params={"filename": path.name}, content=path.read_bytes()).json()
        client.post(f"/imports/{uploaded['id']}", json=MAPPING).raise_for_status()
        n += 1
        while (state := client.get("/imports").json()["last"])["is_running"]:
            if time.monotonic() >= until_s:
                watch.phase = AFTER
            time.sleep(0.2)
        if state["error"] is not None:
            raise RuntimeError(state["error"])
    return n


def ratio(found: dict[str, list[float]], quantile: float) -> tuple[float, float, float]:
    """Return the quantile without and with imports [ms], and how many times as much it is: medians over the turns."""
    turns = range(sum(phase.startswith(IMPORT) for phase in found))
    none, during = (
        np.array([1e3 * np.quantile(found[f"{what} {turn}"], quantile) for turn in turns]) for what in (NONE, IMPORT)
    )
    return float(np.median(none)), float(np.median(during)), float(np.median(during / none))


def main() -> None:
    """Measure, and print one table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--megabytes", type=float, default=37.0)
    parser.add_argument("--seconds", type=float, default=20.0, help="of one turn, without as with imports")
    parser.add_argument("--turns", type=int, default=5)
    args = parser.parse_args()
    n, before = 0, os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as folder, served("--seed", "4") as service:
        path = Path(folder) / "large.csv"
        write_csv(path, args.megabytes)
        time.sleep(WARM_S)
        watch = Watch(service)
        try:
            with httpx.Client(base_url=service.url + "/api/v1", timeout=ANSWER_S) as client:
                for turn in range(args.turns):
                    watch.phase = f"{NONE} {turn}"
                    time.sleep(args.seconds)
                    watch.phase = f"{IMPORT} {turn}"
                    n += bring_in(client, path, watch, time.monotonic() + args.seconds)
        finally:
            watch.end()
    print(f"{n} imports of {args.megabytes:g} MB in {args.turns} turns of twice {args.seconds:g} s;", end=" ")
    print(f"load before {before:.1f}, after {os.getloadavg()[0]:.1f}")
    print("| | median ms, none | median ms, import | change | 99 % ms, none | 99 % ms, import | change |")
    print("| --- | ---: | ---: | ---: | ---: | ---: | ---: |")
    for name, found in (("frame to reader", watch.late_s), ("file behind", watch.behind_s)):
        cells = []
        for quantile in (0.5, 0.99):
            none, during, times = ratio(found, quantile)
            cells += [f"{none:.1f}", f"{during:.1f}", f"{100 * (times - 1):+.0f} %"]
        print(f"| {name} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
