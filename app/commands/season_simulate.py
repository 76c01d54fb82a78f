"""`voltwall season simulate`: a season of simulated sessions, in and between which the cells age."""

from __future__ import annotations

import argparse
import math
import sys
from datetime import UTC, datetime
from typing import Final

from app.clock import Clock
from app.commands.arguments import Actions, data_folder, new_action
from app.commands.console import between
from app.errors import ConfigError
from app.estimation.cell_model.default_cell import DEFAULT_CELL

DAY_NS: Final = 86_400 * 10**9
YEAR_DAYS: Final = 365.25
REST_S: Final = 150.0  # before and after: the voltages of 120 s tell the SOC
LEFT_S: Final = 10.0  # after the last rest


def add_arguments(actions: Actions) -> None:
    """Declare the action."""
    text = "simulate a season of sessions with ageing cells that ends today"
    parser = new_action(actions, "simulate", text, simulate)
    parser.add_argument(
        "--sessions", type=int, default=12, metavar="N", help="number of sessions (default: %(default)s)"
    )
    parser.add_argument(
        "--days",
        type=between(1, 3650, "days"),
        default=240.0,
        help="days from the first to the last session (default: %(default)g)",
    )
    parser.add_argument(
        "--drive-s",
        type=between(30, 7200, "s"),
        default=420.0,
        metavar="S",
        help="driving time per session, between two rests (default: %(default)g)",
    )
    parser.add_argument(
        "--use-ah",
        type=between(0, 1000, "Ah"),
        default=40.0,
        metavar="AH",
        help="throughput per cell between sessions (default: %(default)g)",
    )
    parser.add_argument(
        "--pace",
        action="append",
        default=[],
        metavar="PACK/CELL=TIMES",
        help="cell that ages faster by this factor, such as 3/7=4; repeatable",
    )
    parser.add_argument(
        "--seed", type=int, default=25, metavar="N", help="random seed of the cells (default: %(default)s)"
    )
    parser.add_argument(
        "--speed",
        type=between(1, 100, "times real time"),
        default=10.0,
        help="speed relative to real time (default: %(default)g)",
    )


def scenario_of(k: int, args: argparse.Namespace) -> str:
    """Return session `k`, from 0, as a scenario for the simulator."""
    day = args.days * k / max(args.sessions - 1, 1)
    ambient = 22.0 + 6.0 * math.sin(2.0 * math.pi * day / YEAR_DAYS)
    paces = "\n".join(f'"{place}" = {float(times)}' for place, times in map(_pace, args.pace))
    return f"""title = "Session {k + 1} of a season"
description = "Cells that have aged since the first one."
seed = {args.seed}
[start]
soc = 0.92
ambient_degc = {ambient:.2f}
aged_days = {day:.3f}
aged_degc = {ambient:.2f}
aged_ah = {k * args.use_ah:.3f}
ageing = 1
[start.paces]
{paces}
[[phase]]
load = "rest"
for_s = {REST_S}
[[phase]]
load = "endurance"
for_s = {args.drive_s}
[[phase]]
load = "rest"
for_s = {REST_S}
"""


def simulate(args: argparse.Namespace) -> int:
    """Record the sessions; 1 where one was not recorded.

    Raises:
        ConfigError: an option is wrong.
    """
    from app.commands.season_play import play
    from app.live.pipeline_factory import PipelineFactory

    if not 1 <= args.sessions <= 1000:
        raise ConfigError("--sessions", args.sessions, "1..1000")
    folder = data_folder(args) / "sessions"
    folder.mkdir(parents=True, exist_ok=True)
    length_s = 2.0 * REST_S + args.drive_s + LEFT_S
    factory = PipelineFactory("fused", DEFAULT_CELL)
    end_ns = Clock().wall_ns()
    missing = 0
    for k in range(args.sessions):
        before = args.days * (1.0 - k / max(args.sessions - 1, 1))
        start_ns = end_ns - round(before * DAY_NS) - round(length_s * 1e9)
        session = play(scenario_of(k, args), length_s, folder, args.speed, factory, start_ns)
        missing += session is None
        when = datetime.fromtimestamp(start_ns / 1e9, UTC).date()
        print(f"{k + 1}/{args.sessions} {when} {session or 'not recorded'}", file=sys.stderr, flush=True)
    print(f"{args.sessions - missing} sessions in {folder}")
    return 1 if missing else 0


def _pace(text: str) -> tuple[str, float]:
    place, equals, times = text.partition("=")
    try:
        return place, float(times if equals else "")
    except ValueError as error:
        raise ConfigError("--pace", text, "PACK/CELL=TIMES") from error
