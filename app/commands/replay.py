"""`voltwall replay`: a recorded session through the same pipeline, into the browser or as JSON lines."""

import argparse
import json
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import Any

from app.analysis.expectations import Expectations
from app.analysis.replay import cell_for, prove
from app.analysis.session_cell import judged_by
from app.api.application import Replay
from app.api.encoding.encoder import snapshot_json
from app.commands.console.progress import Progress
from app.commands.console.terminal import GREEN, RED, coloured
from app.commands.serve import serve
from app.commands.session_commands.selection import find_session
from app.errors import ConfigError
from app.estimation.cell_model.default_cell import DEFAULT_CELL
from app.live.pipeline import Pipeline
from app.live.pipeline_factory import PipelineFactory
from app.service import log
from app.service.settings import Settings
from app.sessions.info import RecordedConfig
from app.sessions.reading.reader import SessionFile
from app.sessions.replay import item_of, prepare
from app.telemetry.service_state import ServiceState

DEFAULT_FILTER = "fused"
NO_SERVICE = ServiceState(recording=None, replay=None, last_event_id=0, config_stored_hash=None)


def run(args: argparse.Namespace) -> int:
    """Print or serve.

    Raises:
        SessionError: there is no such session, or the file is none.
        ConfigError: a cell, a speed or a port that cannot be used.
    """
    path = find_session(args, args.session)
    if args.expected is not None:
        return _prove(path, args.expected, args.filter, args.cell, args.json)
    filter_name: Any = args.filter or DEFAULT_FILTER  # one of FILTERS: the parser has looked
    if args.json:
        return _print_snapshots(path, filter_name, args.cell)
    log.configure("info")
    with SessionFile(path):
        pass  # refuse what is no session before anything starts
    with tempfile.TemporaryDirectory(prefix="voltwall-replay-") as data:
        settings = Settings(
            host=args.host, port=args.port, filter=filter_name, cell=args.cell or DEFAULT_CELL, data=Path(data)
        )
        settings.check()
        return serve(settings, replay=Replay(path, args.speed, args.estimates, args.cell))


def _pipeline(session: SessionFile, filter_name: str, chosen: str | None) -> Pipeline:
    name, cell = cell_for(session, chosen)
    return PipelineFactory(filter_name, name, session.loaded_battery, cell).pipeline("replay", "recorded", "recorded")


def _print_snapshots(path: Path, filter_name: str, cell_name: str | None) -> int:
    with SessionFile(path) as file:
        pipeline = _pipeline(file, filter_name, cell_name)
        prepare(pipeline, file)
        for received in file.received():
            if isinstance(received, RecordedConfig):
                continue  # the stream carries it too
            snapshot = pipeline.feed(item_of(received)).snapshot
            pipeline.predict()
            if snapshot is not None:
                sys.stdout.buffer.write(snapshot_json(snapshot, NO_SERVICE) + b"\n")
    return 0


def _prove(path: Path, expected: Path, filter_name: str | None, cell_name: str | None, as_json: bool) -> int:
    try:
        text = expected.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError("--assert", expected, f"a file that can be read: {error}") from error
    with SessionFile(path) as session:
        expectations = Expectations(text, session.battery)
        chosen = filter_name or expectations.filter_name or DEFAULT_FILTER
        pipeline = _pipeline(session, chosen, cell_name or expectations.cell_name)
        judged = [each.text for each in judged_by(session, cell_name or expectations.cell_name)]
        progress = Progress(path.stem)
        verdicts = prove(session, expectations, pipeline, progress)
        progress.end()
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
