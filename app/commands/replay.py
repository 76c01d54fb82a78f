"""`voltwall replay`: a recorded session through the same pipeline, into the browser or as JSON lines."""

import argparse
import sys
import tempfile
from pathlib import Path

from app import log
from app.api.encode import snapshot_json
from app.commands.serve import serve
from app.errors import ConfigError
from app.estimation.cellfile import load_cell
from app.estimation.errors import EstimatorError
from app.estimation.estimators import FILTERS, make_estimator
from app.main import Replay
from app.outlook import Lookout
from app.pipeline import Pipeline
from app.replaying import item_of, prepare
from app.sessions.info import RecordedConfig
from app.sessions.reader import SessionFile
from app.settings import Settings
from firmware_protocol.memory_map import N_CELLS

NO_SERVICE = {"recording": None, "replay": None, "last_event_id": 0, "config_stored_hash": None}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What and how."""
    parser.add_argument("file", type=Path, metavar="FILE", help="a session: one .sqlite file")
    parser.add_argument("--speed", type=float, default=1.0, help="0.1 to 100 times real time (default: 1)")
    parser.add_argument("--json", action="store_true", help="print every snapshot as a line of JSON, without a server")
    parser.add_argument("--filter", choices=FILTERS, default="fused", help="state estimator (default: fused)")
    parser.add_argument("--cell", default="samsung-25r-10p", metavar="CELL.toml", help="cell file or name")
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on (default: 127.0.0.1)")
    parser.add_argument("--port", type=int, default=8000, help="port to listen on; 0 takes a free one (default: 8000)")


def run(args: argparse.Namespace) -> int:
    """Print or serve.

    Raises:
        SessionError: the file is no session.
        ConfigError: a cell, a speed or a port that cannot be used.
    """
    if not args.file.is_file():
        raise ConfigError("file", args.file, "no such session file")
    if args.json:
        return _print_snapshots(args.file, args.filter, args.cell)
    log.configure("info")
    with SessionFile(args.file):
        pass  # refuse what is no session before anything starts
    with tempfile.TemporaryDirectory(prefix="voltwall-replay-") as data:
        settings = Settings(host=args.host, port=args.port, filter=args.filter, cell=args.cell, data=Path(data))
        settings.check()
        return serve(settings, replay=Replay(args.file, args.speed))


def _print_snapshots(path: Path, filter_name: str, cell_name: str) -> int:
    try:
        cell = load_cell(cell_name)
    except EstimatorError as error:
        raise ConfigError("cell", cell_name, str(error)) from error
    pipeline = Pipeline(
        "replay",
        lambda: make_estimator(filter_name, cell, N_CELLS),
        filter_name=filter_name,
        cell_name=cell_name,
        rs232_url="recorded",
        can_url="recorded",
        lookout=Lookout(cell, N_CELLS),
    )
    with SessionFile(path) as file:
        prepare(pipeline, file)
        for received in file.received():
            if isinstance(received, RecordedConfig):
                continue  # the stream carries it too
            snapshot = pipeline.feed(item_of(received)).snapshot
            pipeline.look_ahead()
            if snapshot is not None:
                sys.stdout.buffer.write(snapshot_json(snapshot, NO_SERVICE) + b"\n")
    return 0
