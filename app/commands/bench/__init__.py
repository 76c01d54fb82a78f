"""`voltwall bench`: this machine's figures, with the method beside each."""

import argparse
import json
import os
import platform
import sys
from importlib import import_module
from typing import Any

from app.commands.bench.numerics import CHIP_US, chain_rates, filter_pass_us
from app.commands.bench.service import Passed, at_line_limit, simulated
from app.commands.console.number import between as between
from app.commands.console.progress import Progress
from app.commands.console.terminal import print_table
from app.errors import ConfigError
from app.live.pipeline_factory import PipelineFactory

Row = tuple[str, str, str]  # what, figure, method
_FILTERS = ("fused", "coulomb", "ekf", "ukf", "cdkf")
_FIRST_SNAPSHOT_S = 5.0  # of a service, until it is measured


def run(args: argparse.Namespace) -> int:
    """Measure and print.

    Raises:
        ConfigError: there is no such cell.
    """
    PipelineFactory("coulomb", args.cell)  # refuse a cell that is none before minutes of measuring
    rows = _predictions() if args.predictions else _of_machine(args.cell, args.seconds)
    if args.json:
        print(json.dumps([dict(zip(("what", "figure", "method"), row, strict=True)) for row in rows], indent=2))
        return 0
    print(f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}\n")
    print_table((), rows, "<><")
    return 0


def _of_machine(cell: str, seconds: float) -> list[Row]:
    """Numbers first, then the service; how far it is counts in seconds that each part takes on a quiet machine."""
    at_line = [_FIRST_SNAPSHOT_S + seconds] if os.name == "posix" else []
    parts_s = [*(1.0 for _ in (*_FILTERS, "chain")), _FIRST_SNAPSHOT_S + seconds, *at_line]
    progress, done_s = Progress("bench"), 0.0

    def passed(more_s: float) -> None:
        nonlocal done_s
        done_s += more_s
        progress(round(1000 * done_s), round(1000 * sum(parts_s)))

    rows = [*_numerics(cell, passed), *_service(seconds, passed)]
    progress.end()
    return rows


def _numerics(cell: str, passed: Passed) -> list[Row]:
    rows: list[Row] = []
    for name in _FILTERS:
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


def _service(seconds: float, passed: Passed) -> list[Row]:
    live = simulated(seconds, passed)
    passed(_FIRST_SNAPSHOT_S)
    rows: list[Row] = [
        (
            "start-up to 96 live cells",
            f"{live.start_s:.2f} s",
            "process start to snapshot, simulator included",
        ),
        ("CPU at 10 Hz", _percent(live.cpu_percent), f"service process, recording, one client, {seconds:g} s"),
        ("resident memory", _megabytes(live.resident_mb), "service process, same run"),
        ("session file", f"{live.session_mb_per_hour:.0f} MB/h", f"growth over {seconds:g} s at {live.rate_hz:.1f} Hz"),
    ]
    if os.name != "posix":
        return rows
    line = at_line_limit(seconds, passed)
    passed(_FIRST_SNAPSHOT_S)
    per_s = line.sent / line.seconds
    rows += [
        ("frames at the line's limit", f"{per_s:.1f} /s", f"{line.sent} frames back to back through a pseudo-terminal"),
        ("frames lost", f"{line.sent - line.received}", f"sequence gaps {line.lost}, bad {line.bad}"),
        (
            "last byte to websocket client, p50",
            f"{line.p50_ms:.1f} ms",
            "from the last byte's write, same clock",
        ),
        ("last byte to websocket client, p99", f"{line.p99_ms:.1f} ms", "same run"),
        ("CPU at the line's limit", _percent(line.cpu_percent), "service process, recording, one client"),
        ("resident memory at the line's limit", _megabytes(line.resident_mb), "same run"),
    ]
    return rows


def _percent(value: float | None) -> str:
    return "unknown" if value is None else f"{value:.1f} % of a core"


def _megabytes(value: float | None) -> str:
    return "unknown" if value is None else f"{value:.0f} MB"


def _predictions() -> list[Row]:
    sys.path.insert(0, os.getcwd())  # noqa: PTH109  benchmarks/ is part of a checkout, not of the package
    try:
        module: Any = import_module("benchmarks.predictions")
    except ImportError as error:
        raise ConfigError(
            "--predictions", error.name, "run it in a checkout with the bench packages installed"
        ) from error
    return [tuple(row) for row in module.run()]
