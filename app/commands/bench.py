"""`voltwall bench`: this machine's figures, with the method next to each."""

from __future__ import annotations

import argparse
import json
import os
import platform
from typing import TYPE_CHECKING

from app.commands.console import Progress, between, print_table
from app.estimation.filters.filter_names import FILTERS

if TYPE_CHECKING:
    from app.commands.bench_measurements import Row

_FIRST_SNAPSHOT_S = 5.0  # time of a new service until it is measured


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments: what to measure and for how long."""
    parser.set_defaults(run=run)
    parser.add_argument(
        "--seconds",
        type=between(1.0, 86400.0, "s"),
        default=30.0,
        help="duration of each run of the service (default: 30)",
    )
    parser.add_argument("--cell", default="samsung-25r-10p", help="cell file or bundled cell (default: %(default)s)")
    parser.add_argument("--json", action="store_true", help="print JSON")


def run(args: argparse.Namespace) -> int:
    """Measure and print.

    Raises:
        ConfigError: there is no such cell.
    """
    from app.live.pipeline_factory import PipelineFactory

    PipelineFactory("coulomb", args.cell)  # refuse a cell that is none before minutes of measuring
    rows = _of_machine(args.cell, args.seconds)
    if args.json:
        print(json.dumps([dict(zip(("what", "figure", "method"), row, strict=True)) for row in rows], indent=2))
        return 0
    print(f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}\n")
    print_table((), rows, "<><")
    return 0


def _of_machine(cell: str, seconds: float) -> list[Row]:
    """Numbers first, then the service; how far it is counts in seconds that each part takes on a quiet machine."""
    from app.commands.bench_measurements import at_line_limit, numerics, simulated

    at_line = [_FIRST_SNAPSHOT_S + seconds] if os.name == "posix" else []
    parts_s = [*(1.0 for _ in (*FILTERS, "chain")), _FIRST_SNAPSHOT_S + seconds, *at_line]
    done_s = 0.0

    def passed(more_s: float) -> None:
        nonlocal done_s
        done_s += more_s
        progress(round(1000 * done_s), round(1000 * sum(parts_s)))

    with Progress("bench") as progress:
        rows = [*numerics(cell, passed), *simulated(seconds, passed)]
        passed(_FIRST_SNAPSHOT_S)
        if at_line:
            rows += at_line_limit(seconds, passed)
    return rows
