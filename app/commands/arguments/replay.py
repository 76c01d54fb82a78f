"""`voltwall replay`: a recorded session through the same pipeline, into the browser or as JSON lines."""

import argparse
from pathlib import Path

from app.commands.arguments.common import add_data_argument, add_session_argument
from app.commands.arguments.work import Work
from app.commands.console.number import between
from app.estimation.cell_model.default_cell import DEFAULT_CELL
from app.estimation.filters.filter_names import FILTERS
from app.sessions.replay_schedule import MAX_SPEED, MIN_SPEED


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What and how."""
    parser.set_defaults(do=Work("replay.run"))
    add_session_argument(parser)
    add_data_argument(parser)
    parser.add_argument(
        "--speed",
        type=between(MIN_SPEED, MAX_SPEED, "times real time"),
        default=1.0,
        help="0.1 to 100 times real time (default: 1)",
    )
    parser.add_argument("--json", action="store_true", help="print every snapshot as a line of JSON, without a server")
    parser.add_argument(
        "--assert",
        dest="expected",
        type=Path,
        metavar="FILE",
        help="check alarms and estimates against a TOML file of expectations, without a server;\n"
        "exit code 0: all held, 1: one did not, 2: it could not be checked. With --json the verdicts as JSON",
    )
    parser.add_argument("--filter", choices=FILTERS, help="recompute with this state estimator (default: fused)")
    parser.add_argument(
        "--cell",
        metavar="CELL.toml",
        help=f"recompute with this cell file or name (default: the session's own, {DEFAULT_CELL} where it keeps none)",
    )
    parser.add_argument(
        "--estimates",
        choices=("recomputed", "recorded"),
        default="recomputed",
        help="which estimates the pages show; both are told (default: recomputed)",
    )
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on (default: 127.0.0.1)")
    parser.add_argument("--port", type=int, default=8000, help="port to listen on; 0 takes a free one (default: 8000)")
