"""A battery of any size from its bus to a websocket client: `python -m benchmarks.battery_service [--cells 14,96,…]`.

`voltwall serve --battery` with its simulated car on a real CAN bus, a DBC of one signal a cell. Latency: from the time
at which the newest cell voltage of a snapshot was measured to the arrival of the snapshot at the client, on one clock;
it holds the wait for the end of a measuring period (100 ms). Memory and processor are those of the service's process,
without its car.
"""

import argparse
import json
import tempfile
import time
from pathlib import Path

import numpy as np
from websockets.sync.client import connect

from app.commands.bench.process import cpu_s, resident_mb
from app.commands.bench.service import served
from benchmarks.batteries import battery_of, dbc_of

FIRST_S = 60.0  # until every cell was heard
PROFILE = """[battery]
name = "{n} cells"
segments = {segments}
[battery.temperatures]
sensors = {n_sensors}
cells = [{cells}]
[source]
dbc = "made.dbc"
[[source.voltage]]
signal = "V{{cell}}"
[[source.temperature]]
signal = "T{{cell}}"
[source.current]
signal = "Status.I"
positive = "discharge"
[source.pack_voltage]
signal = "Status.U"
"""


def write_profile(n_cells: int, folder: Path) -> Path:
    """Write profile and DBC of a battery of this size, and return the profile's path."""
    battery = battery_of(n_cells).battery
    (folder / "made.dbc").write_text(dbc_of(n_cells, battery.n_sensors))
    path = folder / "made.toml"
    sensors = ", ".join(str([cell + 1 for cell in cells]) for cells in battery.sensors)
    path.write_text(
        PROFILE.format(n=n_cells, segments=list(battery.segments), n_sensors=battery.n_sensors, cells=sensors)
    )
    return path


def measure(n_cells: int, seconds: float) -> dict[str, float]:
    """Serve a battery and return its figures."""
    with (
        tempfile.TemporaryDirectory() as folder,
        served("--battery", str(write_profile(n_cells, Path(folder))), "--no-record", "--seed", "4") as service,
        connect(service.url.replace("http", "ws", 1) + "/api/v1/live", max_size=1 << 23) as socket,
    ):
        until = time.monotonic() + FIRST_S
        while json.loads(socket.recv())["accumulator"]["loaded_cells"] < n_cells and time.monotonic() < until:
            pass
        before_s, began = cpu_s(service.process.pid) or 0.0, time.monotonic()
        late_ms = []
        while time.monotonic() - began < seconds:
            text = socket.recv()
            now = time.time()
            snapshot = json.loads(text)
            if snapshot["age"]["voltage"] is not None:
                late_ms.append(1e3 * (now - snapshot["time"] + snapshot["age"]["voltage"]))
        used_s = (cpu_s(service.process.pid) or 0.0) - before_s
        return {
            "cells": n_cells,
            "snapshots_a_second": len(late_ms) / seconds,
            "latency_ms": float(np.median(late_ms)),
            "latency_99_ms": float(np.quantile(late_ms, 0.99)),
            "core_percent": 100 * used_s / seconds,
            "resident_mb": resident_mb(service.process.pid) or float("nan"),
        }


def main() -> None:
    """Measure each battery and print one table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", default="14,96,216,600")
    parser.add_argument("--seconds", type=float, default=20.0)
    args = parser.parse_args()
    for i, n_cells in enumerate(args.cells.split(",")):
        figures = measure(int(n_cells), args.seconds)
        if i == 0:
            print("| " + " | ".join(name.replace("_", " ") for name in figures) + " |")
            print("|" + " ---: |" * len(figures))
        print("| " + " | ".join(f"{value:.3g}" for value in figures.values()) + " |", flush=True)


if __name__ == "__main__":
    main()
