"""`voltwall sessions`: what has been recorded."""

import argparse
import json
import sys
import time
from datetime import UTC, datetime
from pathlib import Path

from app.commands import bringing, debrief, importing
from app.errors import ConfigError
from app.sessions.catalogue import Catalogue
from app.sessions.errors import SessionError
from app.sessions.files import is_in_use
from app.sessions.info import SessionInfo
from app.sessions.reader import SessionFile
from app.settings import Settings

OWN = ("list", "show", "markers", "check", "delete", "prune")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "action",
        nargs="?",
        default="list",
        choices=(
            "list",
            "show",
            "markers",
            "check",
            "delete",
            "prune",
            *bringing.ACTIONS,
            *importing.ACTIONS,
            *debrief.ACTIONS,
            *debrief.OF_ALL,
        ),
        help="list     all sessions, newest first (the default)\n"
        "show     one session: times, counts, signals, configurations, events\n"
        "markers  its markers\n"
        "check    read every byte of it, or of all sessions; exit code 1 where something is wrong\n"
        "delete   delete it for ever (asks for --yes)\n"
        "prune    what --older-than and --keep-gb leave over; deletes it with --yes\n"
        + bringing.HELP
        + importing.HELP
        + debrief.HELP.rstrip(),
    )
    parser.add_argument("session", nargs="?", help="the session's id or file; fetch: the other service's URL")
    parser.add_argument("--data", type=Path, metavar="DIR", help="data folder of the service")
    parser.add_argument("--json", action="store_true", help="as JSON")
    parser.add_argument("--yes", action="store_true", help="delete without asking")
    parser.add_argument("--older-than", type=float, metavar="DAYS", help="prune: sessions that ended longer ago")
    parser.add_argument("--keep-gb", type=float, metavar="GB", help="prune: all but so much of the newest")
    bringing.add_arguments(parser)
    importing.add_arguments(parser)
    debrief.add_arguments(parser)


def data_folder(chosen: Path | None) -> Path:
    """Return the data folder: the one chosen, else the service's."""
    return chosen if chosen is not None else Settings.model_validate({}).data


def find_session(data: Path | None, session: str) -> Path:
    """Return the file of a session given by id or by path.

    Raises:
        SessionNotFound: neither is there.
    """
    path = Path(session)
    return path if path.is_file() else Catalogue(data_folder(data) / "sessions").path(session)


def run(args: argparse.Namespace) -> int:
    """Do what was asked for.

    Raises:
        AppError: the session is missing or damaged, or must not be touched now.
    """
    if args.action == "list":
        return _list(args)
    if args.action == "check" and args.session is None:
        return _check_all(args)
    if args.action == "prune":
        return _prune(args)
    if args.action in debrief.OF_ALL:
        return debrief.run_of_all(args, data_folder(args.data), Settings.model_validate({}).cell)
    if args.session is None:
        raise ConfigError("session", "(none)", f"{args.action} needs a session's id or file")
    if args.action == "delete":
        return _delete(args)
    if args.action == "fetch":
        return bringing.fetch(args, data_folder(args.data) / "sessions")
    if args.action in importing.ACTIONS:
        return importing.run(args, data_folder(args.data))
    path = find_session(args.data, args.session)
    if args.action == "fill":
        return bringing.fill(args, path, args.source and find_session(args.data, args.source))
    if args.action == "check":
        return _check(path)
    in_use = is_in_use(path)
    with SessionFile(path) as session:
        if args.action in debrief.ACTIONS:
            return debrief.run(args, session, find_session)
        if args.action == "show":
            _show(session, in_use, args.json)
        else:
            _markers(session, args.json)
    return 0


def _when(wall_ns: int | None) -> str:
    return "?" if wall_ns is None else datetime.fromtimestamp(wall_ns / 1e9, UTC).strftime("%Y-%m-%d %H:%M:%SZ")


def _state(info: SessionInfo, in_use: bool) -> str:
    if info.is_closed:
        return "closed"
    return "recording" if in_use else "cut off"


def _facts(info: SessionInfo, in_use: bool) -> dict[str, object]:
    return {
        "id": info.id,
        "name": info.name,
        "state": _state(info, in_use),
        "started": _when(info.started_wall_ns),
        "ended": _when(info.ended_wall_ns),
        "duration_s": round(info.duration_s, 3),
        "frames": info.frames,
        "can_frames": info.can_frames,
        "events": info.events,
        "markers": info.markers,
        "bytes": info.size_bytes,
        "voltwall": info.voltwall,
        "map_hash": info.map_hash,
        "metadata": dict(info.metadata),
    }


def _list(args: argparse.Namespace) -> int:
    sessions, problems = Catalogue(data_folder(args.data) / "sessions").survey()
    if args.json:
        print(json.dumps([_facts(info, is_in_use(info.path)) for info in sessions], indent=2))
    else:
        print(f"{'id':20} {'started':20} {'length':>9} {'frames':>9} {'MB':>7} {'state':9} name")
        for info in sessions:
            length = f"{info.duration_s / 60:.1f} min"
            print(
                f"{info.id:20} {_when(info.started_wall_ns):20} {length:>9} {info.frames:>9}"
                f" {info.size_bytes / 1e6:>7.1f} {_state(info, is_in_use(info.path)):9} {info.name}"
            )
    for problem in problems:
        print(problem, file=sys.stderr)
    return 0


def _show(session: SessionFile, in_use: bool, as_json: bool) -> None:
    facts = _facts(session.info, in_use) | {
        "signals": session.signal_names(),
        "configurations": [{"time": _when(c.t_wall_ns), "why": c.why} for c in session.configs()],
        "event_list": [
            {"time": _when(int(str(e["t_wall_ns"]))), "severity": e["severity"], "text": e["text"], "cell": e["cell"]}
            for e in session.events()
        ],
    }
    if as_json:
        print(json.dumps(facts, indent=2))
        return
    for name, value in facts.items():
        if isinstance(value, list) and value and isinstance(value[0], dict):
            print(f"{name}:")
            for each in value:
                print("  " + "  ".join(str(part) for part in each.values() if part is not None))
        elif isinstance(value, list):
            print(f"{name}: {' '.join(value)}")
        else:
            print(f"{name}: {value}")


def _markers(session: SessionFile, as_json: bool) -> None:
    start_ns = session.info.started_mono_ns
    found = [
        {
            "at_s": round((marker.t_mono_ns - start_ns) / 1e9, 3),
            "time": _when(marker.t_wall_ns),
            "kind": marker.kind,
            "text": marker.text,
            "who": marker.who,
        }
        for marker in session.markers()
    ]
    if as_json:
        print(json.dumps(found, indent=2))
    else:
        for each in found:
            print(
                f"{each['at_s']:>10} s  {each['time']}  {each['kind']}: {each['text']}"
                + (f" ({each['who']})" if each["who"] else "")
            )


def _check(path: Path) -> int:
    in_use = is_in_use(path)
    with SessionFile(path) as session:
        problems = session.problems()
        state = _state(session.info, in_use)
    print(f"{path.stem}: {state}, " + ("sound" if not problems else "; ".join(problems)))
    return 1 if problems else 0


def _check_all(args: argparse.Namespace) -> int:
    sessions, problems = Catalogue(data_folder(args.data) / "sessions").survey()
    for problem in problems:
        print(problem)
    return max([_check(info.path) for info in sessions], default=0) or int(bool(problems))


def _delete(args: argparse.Namespace) -> int:
    catalogue = Catalogue(data_folder(args.data) / "sessions")
    catalogue.path(args.session)
    if not args.yes:
        raise SessionError(f"{args.session} would be deleted for ever: say so with --yes")
    catalogue.delete(args.session)
    print(f"{args.session} deleted")
    return 0


def _prune(args: argparse.Namespace) -> int:
    if args.older_than is None and args.keep_gb is None:
        raise ConfigError("prune", "(nothing)", "say --older-than DAYS, --keep-gb GB or both")
    catalogue = Catalogue(data_folder(args.data) / "sessions")
    found = catalogue.expired(
        time.time_ns(),
        older_than_s=None if args.older_than is None else args.older_than * 86400,
        keep_bytes=None if args.keep_gb is None else round(args.keep_gb * 1e9),
    )
    for info in found:
        if args.yes:
            catalogue.delete(info.id)
        print(
            f"{info.id}  {info.size_bytes / 1e6:.1f} MB  {info.name}: {'deleted' if args.yes else 'kept without --yes'}"
        )
    return 0
