"""`voltwall sessions`: what has been recorded."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.clock import Clock
from app.commands import session_analysis, session_import, session_transfer
from app.commands.arguments import (
    add_data_argument,
    add_json_argument,
    add_session_argument,
    catalogue,
    find_session,
    new_action,
)
from app.commands.console import GREEN, RED, Progress, coloured, print_table, printable
from app.errors import ConfigError
from app.sessions.errors import SessionError
from app.sessions.storage.files import is_in_use

if TYPE_CHECKING:
    from app.sessions.info import SessionInfo
    from app.sessions.reading.reader import SessionFile


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the actions; without one the sessions are listed."""
    add_data_argument(parser)
    add_json_argument(parser, default=False)
    parser.set_defaults(run=list_sessions)
    actions = parser.add_subparsers(dest="action", metavar="ACTION")
    add_json_argument(new_action(actions, "list", "list sessions, newest first (default)", list_sessions))
    show = new_action(
        actions, "show", "show a session: times, counts, signals, markers, configurations, events", show_session
    )
    markers = new_action(actions, "markers", "list the markers of a session", list_markers)
    for action in (show, markers):
        add_session_argument(action)
        add_json_argument(action)
    text = "check one or all sessions for damage; exit code 1 if damaged"
    check = new_action(actions, "check", text, check_sessions)
    add_json_argument(check)
    check.add_argument("session", metavar="SESSION", nargs="?", help="session ID or file (default: all)")
    check.add_argument("--repair", type=Path, metavar="OUT", help="write the readable part of SESSION to a new file")
    delete = new_action(actions, "delete", "delete a session permanently", delete_session)
    add_session_argument(delete)
    text = "list (with --yes: delete) sessions beyond the limits"
    prune = new_action(actions, "prune", text, prune_sessions)
    prune.add_argument("--older-than", type=float, metavar="DAYS", help="select sessions older than this")
    prune.add_argument("--keep-gb", type=float, metavar="GB", help="select the oldest sessions beyond this total size")
    add_json_argument(prune)
    for action in (delete, prune):
        action.add_argument("--yes", action="store_true", help="delete without asking")
    for part in (session_analysis, session_transfer, session_import):
        part.add_arguments(actions)


def _when(wall_ns: int | None) -> str:
    return "?" if wall_ns is None else datetime.fromtimestamp(wall_ns / 1e9, UTC).strftime("%Y-%m-%d %H:%M:%SZ")


def _state(info: SessionInfo, in_use: bool | None = None) -> str:
    """`in_use` where somebody has asked before; who reads the file is a user of it."""
    if info.is_closed:
        return "closed"
    return "recording" if (is_in_use(info.path) if in_use is None else in_use) else "cut off"


def _facts(info: SessionInfo, in_use: bool | None = None) -> dict[str, object]:
    return {
        "id": info.id,
        "name": info.name,
        "state": _state(info, in_use),
        "started": _when(info.started_wall_ns),
        "ended": _when(info.ended_wall_ns),
        "duration_s": round(info.duration_s, 3),
        **{name: getattr(info, name) for name in ("frames", "can_frames", "events", "markers")},
        "bytes": info.size_bytes,
        "voltwall": info.voltwall,
        "map_hash": info.map_hash,
        "metadata": dict(info.metadata),
    }


def list_sessions(args: argparse.Namespace) -> int:
    """Print all sessions, newest first."""
    sessions, problems = catalogue(args).survey()
    if args.json:
        print(json.dumps([_facts(info) for info in sessions], indent=2))
    else:
        rows = [
            (
                info.id,
                _when(info.started_wall_ns),
                f"{info.duration_s / 60:.1f} min",
                str(info.frames),
                f"{info.size_bytes / 1e6:.1f}",
                _state(info),
                info.name,
            )
            for info in sessions
        ]
        print_table(("id", "started", "length", "frames", "MB", "state", "name"), rows, "<<>>><<")
    for problem in problems:
        print(printable(str(problem)), file=sys.stderr)
    return 0


def show_session(args: argparse.Namespace) -> int:
    """Print all about one."""
    from app.sessions.reading.reader import SessionFile

    path = find_session(args, args.session)
    in_use = is_in_use(path)
    with SessionFile(path) as session:
        _show(session, in_use, args.json)
    return 0


def _show(session: SessionFile, in_use: bool, as_json: bool) -> None:
    facts = _facts(session.info, in_use) | {
        "signals": session.signal_names(),
        "marker_list": _marker_facts(session),
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
            for element in value:
                print(printable("  " + "  ".join(str(part) for part in element.values() if part is not None)))
        elif isinstance(value, list):
            print(printable(f"{name}: {' '.join(value)}"))
        else:
            print(printable(f"{name}: {value}"))


def _marker_facts(session: SessionFile) -> list[dict[str, object]]:
    start_ns = session.info.started_mono_ns
    return [
        {
            "at_s": round((marker.t_mono_ns - start_ns) / 1e9, 3),
            "time": _when(marker.t_wall_ns),
            "kind": marker.kind,
            "text": marker.text,
            "who": marker.who,
        }
        for marker in session.markers()
    ]


def list_markers(args: argparse.Namespace) -> int:
    """Print its markers."""
    from app.sessions.reading.reader import SessionFile

    with SessionFile(find_session(args, args.session)) as session:
        markers = _marker_facts(session)
    if args.json:
        print(json.dumps(markers, indent=2))
    else:
        for marker in markers:
            who = f" ({marker['who']})" if marker["who"] else ""
            print(f"{marker['at_s']:>10} s  {marker['time']}  {marker['kind']}: {marker['text']}{who}")
    return 0


def check_sessions(args: argparse.Namespace) -> int:
    """Read every byte; 1 where something is wrong."""
    if args.repair is not None:
        if args.session is None:
            raise ConfigError("repair", args.repair, "name one SESSION")
        return _repair(find_session(args, args.session), args.repair)
    unreadable: Sequence[SessionError] = ()
    if args.session is not None:
        paths = [find_session(args, args.session)]
    else:
        sessions, unreadable = catalogue(args).survey()
        paths = [info.path for info in sessions]
    for problem in unreadable:
        print(printable(str(problem)), file=sys.stderr if args.json else sys.stdout)
    checked: list[dict[str, Any]] = []
    progress = Progress()
    for k, path in enumerate(paths):
        with progress:
            checked.append(_checked(path, progress.share(k, len(paths))))
        if not args.json:
            print(_verdict(checked[-1]))
    if args.json:
        print(json.dumps(checked, indent=2))
    return int(bool(unreadable) or any(session["problems"] for session in checked))


def _checked(path: Path, on_read: Callable[[int, int], None]) -> dict[str, Any]:
    from app.sessions.reading.reader import SessionFile

    in_use = is_in_use(path)
    with SessionFile(path, on_read) as session:
        return {"id": path.stem, "state": _state(session.info, in_use), "problems": session.problems()}


def _verdict(checked: dict[str, Any]) -> str:
    problems = "; ".join(checked["problems"])
    verdict = coloured(problems, RED) if problems else coloured("sound", GREEN)
    return f"{checked['id']}: {checked['state']}, {verdict}"


def _repair(path: Path, target: Path) -> int:
    from app.sessions.transfer.repair import repair

    with Progress(path.stem) as progress:
        lost = repair(path, target, progress)
    for what, count in lost.items():
        if count:
            print(f"{path.stem}: {what}: {count} lost" if " " not in what else f"{path.stem}: {what}: {count}")
    print(f"{path.stem}: {'nothing was lost' if not lost.total() else 'the rest'} is in {target}")
    return 0


def delete_session(args: argparse.Namespace) -> int:
    """Delete one."""
    sessions = catalogue(args)
    sessions.path(args.session)
    if not args.yes:
        raise SessionError(f"{args.session} would be deleted for ever: say so with --yes")
    sessions.delete(args.session)
    print(f"{args.session} deleted")
    return 0


def prune_sessions(args: argparse.Namespace) -> int:
    """Delete what is too old or too much, or say what would be."""
    if args.older_than is None and args.keep_gb is None:
        raise ConfigError("prune", "(nothing)", "say --older-than DAYS, --keep-gb GB or both")
    sessions = catalogue(args)
    expired = sessions.expired(
        Clock().wall_ns(),
        older_than_s=None if args.older_than is None else args.older_than * 86400,
        keep_bytes=None if args.keep_gb is None else round(args.keep_gb * 1e9),
    )
    facts = [_facts(info) | {"deleted": args.yes} for info in expired]
    for info in expired:
        if args.yes:
            sessions.delete(info.id)
        if not args.json:
            done = "deleted" if args.yes else "kept without --yes"
            print(printable(f"{info.id}  {info.size_bytes / 1e6:.1f} MB  {info.name}: {done}"))
    if args.json:
        print(json.dumps(facts, indent=2))
    return 0
