"""`voltwall replay`: a recorded session through the same pipeline, into the browser or as JSON lines."""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.commands.arguments import add_data_argument, add_session_argument, find_session
from app.commands.console import GREEN, RED, Progress, between, coloured
from app.errors import ConfigError
from app.estimation.cell_model.default_cell import DEFAULT_CELL
from app.estimation.filters.filter_names import FILTERS
from app.sessions.replay_schedule import MAX_SPEED, MIN_SPEED

if TYPE_CHECKING:
    from app.live.pipeline import Pipeline
    from app.sessions.reading.reader import SessionFile

DEFAULT_FILTER = "fused"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments: the session and how to play it."""
    parser.set_defaults(run=run)
    add_session_argument(parser)
    add_data_argument(parser)
    parser.add_argument(
        "--speed",
        type=between(MIN_SPEED, MAX_SPEED, "times real time"),
        default=1.0,
        help="speed relative to real time, 0.1 to 100 (default: 1)",
    )
    parser.add_argument(
        "--json", action="store_true", help="print each update as a line of JSON, without serving pages"
    )
    parser.add_argument(
        "--assert",
        dest="expected",
        type=Path,
        metavar="FILE",
        help="check alarms and estimates against expectations (TOML), without serving pages;\n"
        "exit code 0: all met, 1: not met, 2: not checked; --json prints the results as JSON",
    )
    parser.add_argument("--filter", choices=FILTERS, help="recompute with this state estimator (default: fused)")
    parser.add_argument(
        "--cell",
        metavar="CELL.toml",
        help=f"recompute with this cell file or bundled cell (default: the session's, else {DEFAULT_CELL})",
    )
    parser.add_argument(
        "--estimates",
        choices=("recomputed", "recorded"),
        default="recomputed",
        help="estimates shown on the pages (default: recomputed)",
    )
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on (default: 127.0.0.1)")
    parser.add_argument("--port", type=int, default=8000, help="port to listen on, 0 for a free one (default: 8000)")


def run(args: argparse.Namespace) -> int:
    """Print or serve.

    Raises:
        SessionError: there is no such session, or the file is none.
        ConfigError: a cell, a speed or a port that cannot be used.
    """
    path = find_session(args, args.session)
    if args.expected is not None:
        return _prove(path, args.expected, args.filter, args.cell, args.json)
    filter_name = args.filter or DEFAULT_FILTER
    return _print_snapshots(path, filter_name, args.cell) if args.json else _serve(path, filter_name, args)


def _serve(path: Path, filter_name: Any, args: argparse.Namespace) -> int:
    from app.api.application import ServedReplay
    from app.commands.server import serve
    from app.service import log
    from app.service.settings import Settings
    from app.sessions.reading.reader import SessionFile

    log.configure("info")
    SessionFile(path).close()  # refuse what is no session before anything starts
    with tempfile.TemporaryDirectory(prefix="voltwall-replay-") as data:
        settings = Settings(
            host=args.host, port=args.port, filter=filter_name, cell=args.cell or DEFAULT_CELL, data=Path(data)
        )
        settings.check()
        return serve(settings, replay=ServedReplay(path, args.speed, args.estimates, args.cell))


def _pipeline(session: SessionFile, filter_name: str, chosen: str | None) -> Pipeline:
    from app.analysis.replay import cell_for
    from app.live.pipeline_factory import PipelineFactory

    name, cell = cell_for(session, chosen)
    return PipelineFactory(filter_name, name, session.loaded_battery, cell).pipeline("replay", "recorded", "recorded")


def _print_snapshots(path: Path, filter_name: str, cell_name: str | None) -> int:
    from app.api.encoding.encoder import snapshot_json
    from app.sessions.info import RecordedConfig
    from app.sessions.reading.reader import SessionFile
    from app.sessions.replay import item_of, prepare
    from app.telemetry.service_state import ServiceState

    no_service = ServiceState(recording=None, replay=None, last_event_id=0, config_stored_hash=None)
    with SessionFile(path) as file:
        pipeline = _pipeline(file, filter_name, cell_name)
        prepare(pipeline, file)
        for received in file.received():
            if isinstance(received, RecordedConfig):
                continue  # the stream carries it too
            snapshot = pipeline.feed(item_of(received, file.loaded_battery)).snapshot
            pipeline.predict()
            if snapshot is not None:
                sys.stdout.buffer.write(snapshot_json(snapshot, no_service) + b"\n")
    return 0


def _prove(path: Path, expected: Path, filter_name: str | None, cell_name: str | None, as_json: bool) -> int:
    from app.analysis.expectations import Expectations
    from app.analysis.replay import prove
    from app.analysis.session_cell import judged_by
    from app.sessions.reading.reader import SessionFile

    try:
        text = expected.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError("--assert", expected, f"a file that can be read: {error}") from error
    with SessionFile(path) as session:
        expectations = Expectations(text, session.battery)
        chosen = filter_name or expectations.filter_name or DEFAULT_FILTER
        pipeline = _pipeline(session, chosen, cell_name or expectations.cell_name)
        judged = [message.text for message in judged_by(session, cell_name or expectations.cell_name)]
        with Progress(path.stem) as progress:
            verdicts = prove(session, expectations, pipeline, progress)
    failed = sum(not verdict.held for verdict in verdicts)
    if as_json:
        document = {"held": failed == 0, "expectations": [asdict(verdict) for verdict in verdicts], "judged": judged}
        print(json.dumps(document, indent=2))
    else:
        for verdict in verdicts:
            mark = coloured("ok  ", GREEN) if verdict.held else coloured("FAIL", RED)
            print(f"{mark}  {verdict.text}: {verdict.found}")
        print(" ".join(judged))
        print(f"{len(verdicts) - failed} of {len(verdicts)} held")
    return 1 if failed else 0
