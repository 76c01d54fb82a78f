"""What a battery costs by its number of cells, live: `python -m benchmarks.batteries [--cells 14,96,216,600]`.

One process a battery: a DBC of one signal a cell, every cell ten times a second and every temperature twice, frames
that come as from a bus, ten measurements a second through the pipeline of `serve` with its filter, prediction, alarms,
history and JSON. Times are of the processor, so that other work on the machine counts little; what a frame waits for
the end of its period (100 ms at most, `period_s` of the profile) comes on top of the pass.
"""

import argparse
import json
import resource
import subprocess
import sys
import time
from typing import Any

import numpy as np

from app.battery.battery import Battery, SignalName, spread
from app.battery.source import CellSignals, Reading, SpeaksDbc
from app.live.history import History
from app.live.pipeline_factory import PipelineFactory
from app.live.trend import Trend
from app.sources.dbc.dbc_file import parse_definitions
from app.sources.items import CanItem
from app.sources.loaded_battery import LoadedBattery
from app.telemetry.encoding import encode, plain

A_SEGMENT = 12
PERIOD_NS = 100_000_000
EPOCH_NS = 1_790_000_000 * 10**9
HEAD = 'VERSION ""\n\nNS_ :\n\nBS_:\n\nBU_: BMS\n\n'
VOLTAGES, TEMPERATURES, STATUS = 0x80010000, 0x80020000, 0x80030000  # ids of 29 bits: a frame for each four cells


def battery_of(n_cells: int) -> LoadedBattery:
    """Return a battery of segments of twelve (the last may be smaller), with a temperature sensor for two cells."""
    whole, rest = divmod(n_cells, A_SEGMENT)
    segments = (A_SEGMENT,) * whole + ((rest,) if rest else ())
    n_sensors = max(1, n_cells // 2)
    battery = Battery(f"{n_cells} cells", segments, 10, sensors=spread(n_sensors, range(n_cells)))
    source = SpeaksDbc(
        ("made.dbc",),
        {"voltage": (CellSignals("V{cell}"),), "temperature": (CellSignals("T{cell}"),)},
        current=Reading(SignalName("Status", "I")),
        pack_voltage=Reading(SignalName("Status", "U")),
    )
    return LoadedBattery(battery, source, parse_definitions(dbc_of(n_cells, n_sensors).encode(), "made.dbc"), {})


def dbc_of(n_cells: int, n_sensors: int) -> str:
    """Return its DBC: four voltages or eight temperatures a frame."""
    lines = [HEAD]
    for at in range(0, n_cells, 4):
        lines.append(f"BO_ {VOLTAGES + at} Volt{at}: 8 BMS\n")
        lines += [f' SG_ V{at + k} : {16 * k}|16@1+ (0.0001,0) [0|0] "V" X\n' for k in range(min(4, n_cells - at))]
    for at in range(0, n_sensors, 8):
        lines.append(f"BO_ {TEMPERATURES + at} Heat{at}: 8 BMS\n")
        lines += [f' SG_ T{at + k} : {8 * k}|8@1+ (0.5,-40) [0|0] "degC" X\n' for k in range(min(8, n_sensors - at))]
    lines.append(f'BO_ {STATUS} Status: 8 BMS\n SG_ I : 0|16@1- (0.1,0) [0|0] "A" X\n')
    lines.append(' SG_ U : 16|16@1+ (0.1,0) [0|0] "V" X\n')
    return "".join(lines)


def frames_of(battery: Battery, turn: int, rng: np.random.Generator) -> list[CanItem]:
    """Return what comes in one period: a drive in steps, with noise."""
    current_a = (0.0, 60.0, 120.0, -20.0, 90.0)[turn // 13 % 5]
    volts = 3.8 - turn * 1e-5 - 0.002 * current_a + rng.normal(0, 1e-3, battery.n_cells)
    heats = 30 + turn * 1e-3 + rng.normal(0, 0.3, battery.n_sensors)
    counts, degrees = (volts * 1e4).astype("<u2"), ((heats + 40) * 2).astype(np.uint8)
    sent = [(VOLTAGES + at, counts[at : at + 4].tobytes()) for at in range(0, battery.n_cells, 4)]
    if turn % 5 == 0:
        sent += [(TEMPERATURES + at, degrees[at : at + 8].tobytes()) for at in range(0, battery.n_sensors, 8)]
    status = np.array([round(current_a * 10), round(min(float(volts.sum()) * 10, 32767))], "<i2").tobytes() + bytes(4)
    sent.append((STATUS, status))
    begin, step = turn * PERIOD_NS, PERIOD_NS * 9 // 10 // len(sent)
    return [
        CanItem(begin + k * step, EPOCH_NS + begin + k * step, can_id, data.ljust(8, b"\0"))
        for k, (can_id, data) in enumerate(sent)
    ]


def measure(n_cells: int, seconds: int) -> dict[str, Any]:
    """Run one battery and return its figures: times in ms, memory in MB."""
    loaded, rng = battery_of(n_cells), np.random.default_rng(1)
    battery = loaded.battery
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    pipeline = PipelineFactory("fused", None, loaded).pipeline("can", None, "virtual:x")
    pipeline.warm_up()
    history, trend = History(n_cells), Trend(n_cells)
    frame_s, pass_s, judge_s, encode_s, sizes = 0.0, [], [], [], []
    n_frames = 0
    for turn in range(seconds * 10):
        items = frames_of(battery, turn, rng)
        n_frames += len(items)
        first, *others = items
        began = time.process_time()
        output = pipeline.feed(first)  # ends the period before
        took_s = time.process_time() - began
        began = time.process_time()
        for item in others:
            pipeline.feed(item)
        frame_s += time.process_time() - began
        if output.snapshot is None:
            continue
        pass_s.append(took_s)
        began = time.process_time()
        pipeline.predict()
        judge_s.append(time.process_time() - began)
        began = time.process_time()
        sizes.append(len(encode(plain(output.snapshot))))
        encode_s.append(time.process_time() - began)
        history.add(output.snapshot)
        trend.add(output.snapshot)
    memory_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb
    full = sum(array.nbytes for ring in (history, trend) for array in _arrays(ring))
    return {
        "cells": n_cells,
        "frames_a_second": round(n_frames / seconds),
        "frame_us": 1e6 * frame_s / n_frames,
        "pass_ms": 1e3 * float(np.median(pass_s)),
        "pass_99_ms": 1e3 * float(np.quantile(pass_s, 0.99)),
        "judge_ms": 1e3 * float(np.quantile(judge_s, 0.99)),
        "encode_ms": 1e3 * float(np.median(encode_s)),
        "snapshot_kb": float(np.mean(sizes)) / 1e3,
        "core_percent": 100 * (frame_s + sum(pass_s) + sum(judge_s) + sum(encode_s)) / seconds,
        "memory_mb": memory_kb / 1e3,
        "rings_mb": full / 1e6,
    }


def _arrays(value: object) -> list[np.ndarray[Any, Any]]:
    """Every array that an object holds."""
    if isinstance(value, np.ndarray):
        return [value]
    if isinstance(value, dict):
        return [array for each in value.values() for array in _arrays(each)]
    if type(value).__module__.startswith("app.live"):
        return [array for each in vars(value).values() for array in _arrays(each)]
    return []


def main() -> None:
    """Measure each battery in a process of its own and print one table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", default="14,96,216,600")
    parser.add_argument("--seconds", type=int, default=60, help="of driving")
    parser.add_argument("--one", action="store_true", help="print one battery's figures as JSON")
    args = parser.parse_args()
    if args.one:
        print(json.dumps(measure(int(args.cells), args.seconds)))
        return
    names: tuple[str, ...] = ()
    for n_cells in args.cells.split(","):
        command = [sys.executable, "-m", "benchmarks.batteries", "--one", "--cells", n_cells]
        run = subprocess.run([*command, "--seconds", str(args.seconds)], capture_output=True, check=True, text=True)
        figures = json.loads(run.stdout)
        if not names:
            names = tuple(figures)
            print("| " + " | ".join(name.replace("_", " ") for name in names) + " |")
            print("|" + " ---: |" * len(names))
        print("| " + " | ".join(f"{figures[name]:.3g}" for name in names) + " |", flush=True)


if __name__ == "__main__":
    main()
