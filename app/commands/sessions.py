"""`voltwall sessions`: what has been recorded."""

import argparse
import json
import sys
from datetime import UTC, datetime
from pathlib import Path

from app.clock import Clock
from app.commands.session_commands import analysis as debrief
from app.commands.session_commands import importing, passport, transfer
from app.commands.session_commands.selection import (
    add_data_argument,
    add_json_argument,
    add_session_argument,
    catalogue,
    find_session,
    new_action,
)
from app.errors import ConfigError
from app.sessions.errors import SessionError
from app.sessions.info import SessionInfo
from app.sessions.reading.reader import SessionFile
from app.sessions.storage.files import is_in_use
from app.sessions.transfer.repair import repair


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the actions; without one the sessions are listed."""
    add_data_argument(parser)
    add_json_argument(parser, default=False)
    parser.set_defaults(do=_list)
    actions = parser.add_subparsers(dest="action", metavar="ACTION")
    add_json_argument(new_action(actions, "list", "all sessions, newest first (the default)", _list))
    show = new_action(
        actions, "show", "one session: times, counts, signals, markers, configurations, events", _show_one
    )
    markers = new_action(actions, "markers", "the markers of a session", _markers)
    for action in (show, markers):
        add_session_argument(action)
        add_json_argument(action)
    check = new_action(
        actions, "check", "read every byte of a session, or of all; exit code 1 where something is wrong", _check
    )
    check.add_argument("session", metavar="SESSION", nargs="?", help="the session's id, or its file (default: all)")
    check.add_argument(
        "--repair", type=Path, metavar="OUT", help="write what can still be read of SESSION into a new file"
    )
    delete = new_action(actions, "delete", "delete a session for ever", _delete)
    add_session_argument(delete)
    prune = new_action(actions, "prune", "say what --older-than and --keep-gb leave over; delete it with --yes", _prune)
    prune.add_argument("--older-than", type=float, metavar="DAYS", help="sessions that ended longer ago")
    prune.add_argument("--keep-gb", type=float, metavar="GB", help="all but so much of the newest")
    for action in (delete, prune):
        action.add_argument("--yes", action="store_true", help="delete without asking")
    for module in (debrief, passport, transfer, importing):
        module.add_actions(actions)


def run(args: argparse.Namespace) -> int:
    """Do what was asked for.

    Raises:
        AppError: the session is missing or damaged, or must not be touched now.
    """
    return int(args.do(args))


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
    sessions, problems = catalogue(args).survey()
    if args.json:
        print(json.dumps([_facts(info) for info in sessions], indent=2))
    else:
        print(f"{'id':20} {'started':20} {'length':>9} {'frames':>9} {'MB':>7} {'state':9} name")
        for info in sessions:
            length = f"{info.duration_s / 60:.1f} min"
            print(
                f"{info.id:20} {_when(info.started_wall_ns):20} {length:>9} {info.frames:>9}"
                f" {info.size_bytes / 1e6:>7.1f} {_state(info):9} {info.name}"
            )
    for problem in problems:
        print(problem, file=sys.stderr)
    return 0


def _show_one(args: argparse.Namespace) -> int:
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
            for each in value:
                print("  " + "  ".join(str(part) for part in each.values() if part is not None))
        elif isinstance(value, list):
            print(f"{name}: {' '.join(value)}")
        else:
            print(f"{name}: {value}")


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


def _markers(args: argparse.Namespace) -> int:
    with SessionFile(find_session(args, args.session)) as session:
        found = _marker_facts(session)
    if args.json:
        print(json.dumps(found, indent=2))
    else:
        for each in found:
            print(
                f"{each['at_s']:>10} s  {each['time']}  {each['kind']}: {each['text']}"
                + (f" ({each['who']})" if each["who"] else "")
            )
    return 0


def _check(args: argparse.Namespace) -> int:
    if args.repair is not None:
        if args.session is None:
            raise ConfigError("repair", args.repair, "name one SESSION")
        return _repair(find_session(args, args.session), args.repair)
    if args.session is not None:
        return _check_one(find_session(args, args.session))
    sessions, problems = catalogue(args).survey()
    for problem in problems:
        print(problem)
    return max([_check_one(info.path) for info in sessions], default=0) or int(bool(problems))


def _check_one(path: Path) -> int:
    in_use = is_in_use(path)
    with SessionFile(path) as session:
        problems = session.problems()
        state = _state(session.info, in_use)
    print(f"{path.stem}: {state}, " + ("sound" if not problems else "; ".join(problems)))
    return 1 if problems else 0


def _repair(path: Path, target: Path) -> int:
    lost = repair(path, target)
    for what, count in lost.items():
        if count:
            print(f"{path.stem}: {what}: {count} lost" if " " not in what else f"{path.stem}: {what}: {count}")
    print(f"{path.stem}: {'nothing was lost' if not lost.total() else 'the rest'} is in {target}")
    return 0


def _delete(args: argparse.Namespace) -> int:
    sessions = catalogue(args)
    sessions.path(args.session)
    if not args.yes:
        raise SessionError(f"{args.session} would be deleted for ever: say so with --yes")
    sessions.delete(args.session)
    print(f"{args.session} deleted")
    return 0


def _prune(args: argparse.Namespace) -> int:
    if args.older_than is None and args.keep_gb is None:
        raise ConfigError("prune", "(nothing)", "say --older-than DAYS, --keep-gb GB or both")
    sessions = catalogue(args)
    found = sessions.expired(
        Clock().wall_ns(),
        older_than_s=None if args.older_than is None else args.older_than * 86400,
        keep_bytes=None if args.keep_gb is None else round(args.keep_gb * 1e9),
    )
    for info in found:
        if args.yes:
            sessions.delete(info.id)
        print(
            f"{info.id}  {info.size_bytes / 1e6:.1f} MB  {info.name}: {'deleted' if args.yes else 'kept without --yes'}"
        )
    return 0
