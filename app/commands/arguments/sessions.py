"""`voltwall sessions`: what has been recorded."""

import argparse
from pathlib import Path

from app.commands.arguments.common import (
    add_data_argument,
    add_json_argument,
    add_session_argument,
    add_trust_argument,
    new_action,
)
from app.commands.arguments.work import Work
from app.estimation.filters.filter_names import FILTERS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the actions; without one the sessions are listed."""
    add_data_argument(parser)
    add_json_argument(parser, default=False)
    parser.set_defaults(do=Work("sessions.list_sessions"))
    actions = parser.add_subparsers(dest="action", metavar="ACTION")
    add_json_argument(new_action(actions, "list", "all sessions, newest first (the default)", "sessions.list_sessions"))
    show = new_action(
        actions, "show", "one session: times, counts, signals, markers, configurations, events", "sessions.show_session"
    )
    markers = new_action(actions, "markers", "the markers of a session", "sessions.list_markers")
    for action in (show, markers):
        add_session_argument(action)
        add_json_argument(action)
    check = new_action(
        actions,
        "check",
        "read every byte of a session, or of all; exit code 1 where something is wrong",
        "sessions.check_sessions",
    )
    add_json_argument(check)
    check.add_argument("session", metavar="SESSION", nargs="?", help="the session's id, or its file (default: all)")
    check.add_argument(
        "--repair", type=Path, metavar="OUT", help="write what can still be read of SESSION into a new file"
    )
    delete = new_action(actions, "delete", "delete a session for ever", "sessions.delete_session")
    add_session_argument(delete)
    prune = new_action(
        actions,
        "prune",
        "say what --older-than and --keep-gb leave over; delete it with --yes",
        "sessions.prune_sessions",
    )
    prune.add_argument("--older-than", type=float, metavar="DAYS", help="sessions that ended longer ago")
    prune.add_argument("--keep-gb", type=float, metavar="GB", help="all but so much of the newest")
    add_json_argument(prune)
    for action in (delete, prune):
        action.add_argument("--yes", action="store_true", help="delete without asking")
    for add in (_add_analysis, _add_transfer, _add_importing):
        add(actions)


def _add_analysis(actions: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the actions."""
    laps = new_action(
        actions,
        "laps",
        "laps of a session: energy, power, charge, heat, weakest cell; drivers compared",
        "session_commands.analysis.show_laps",
    )
    boxes = new_action(
        actions,
        "blackbox",
        "what happened around every trip and fault of a session",
        "session_commands.analysis.show_black_boxes",
    )
    report = new_action(
        actions, "report", "how a session went, what limited, what to look at", "session_commands.analysis.show_report"
    )
    compare = new_action(actions, "compare", "two sessions side by side", "session_commands.analysis.show_comparison")
    for action in (laps, boxes, report, compare):
        add_session_argument(action)
        add_json_argument(action)
    laps.add_argument(
        "--laps-from",
        metavar="WHERE",
        help="settled, markers, pattern, or what goes up when a lap begins: can:ID:BYTE[:MASK], a byte of a frame;\n"
        "dbc:[MESSAGE.]SIGNAL, a signal of CAN frames by --dbc; signal:NAME, a signal of the session, as\n"
        "signal:charger.flags (default: the first of settled, markers, pattern that there is)",
    )
    laps.add_argument("--dbc", type=Path, metavar="FILE", help="what the CAN frames mean")
    boxes.add_argument("--html", type=Path, metavar="FOLDER", help="write a page to print for each")
    report.add_argument("--html", type=Path, metavar="FOLDER", help="write the whole report with its charts")
    compare.add_argument("--with", dest="other", required=True, metavar="SESSION", help="the other one, id or file")


def _add_transfer(actions: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the actions."""
    fetch = new_action(
        actions,
        "fetch",
        "bring the finished sessions of another voltwall, a recorder in the car, here",
        "session_commands.transfer.fetch",
    )
    fetch.epilog = (
        "They are called LABEL-ID here. A transfer that was cut off goes on, and gaps of the sessions recorded here\n"
        "are filled. With --follow it ends by Ctrl-C, and goes on when it is started again.\n"
        "The other service's password, or a token of it, in VOLTWALL_REMOTE_PASSWORD."
    )
    add_trust_argument(fetch)
    fetch.add_argument("url", metavar="URL", help="the other service, as http://car.local:8000")
    fetch.add_argument("--label", default="", help="what its sessions are called here (default: its host name)")
    fetch.add_argument(
        "--only", action="append", default=[], metavar="ID", help="this session, even while it is recorded"
    )
    fetch.add_argument("--no-fill", action="store_true", help="leave the sessions recorded here as they are")
    fetch.add_argument(
        "--follow",
        action="store_true",
        help="go on for ever, piece by piece, also with what is being recorded: over a radio that loses much",
    )
    fetch.add_argument(
        "--order", choices=("oldest", "newest"), default="oldest", help="with --follow: which pieces come first"
    )
    missing = new_action(
        actions,
        "missing",
        "what is still missing of the sessions that are followed",
        "session_commands.transfer.list_missing",
    )
    add_json_argument(missing)
    fill = new_action(
        actions,
        "fill",
        "put into a session what its link lost and another recorder has",
        "session_commands.transfer.fill",
    )
    add_session_argument(fill)
    fill.add_argument(
        "--from", dest="source", required=True, metavar="SESSION", help="the other recorder's, id or file"
    )


def _add_importing(actions: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the actions."""
    taking = new_action(
        actions,
        "import",
        "make a session of another system's recording, estimated",
        "session_commands.importing.import_recording",
    )
    taking.epilog = (
        "CSV or Parquet; or a CAN log: candump, .asc, .blf, .trc, SavvyCAN, CRTD, .mf4; known by content. A CAN log\n"
        "is of --battery, without it of our own master; with --dbc its signals are taken as a table. A table has the\n"
        "shape of --battery, else one segment."
    )
    columns = new_action(
        actions,
        "columns",
        "what is in such a file, and the profile that is guessed for it",
        "session_commands.importing.show_columns",
    )
    for action in (taking, columns):
        action.add_argument("file", type=Path, metavar="FILE", help="the recording")
        action.add_argument("--dbc", type=Path, metavar="FILE", help="what the CAN frames mean")
    add_json_argument(columns)
    taking.add_argument("--battery", metavar="NAME|FILE", help="whose frames a CAN log holds, or whose cells a table")
    taking.add_argument("--profile", metavar="NAME|FILE", help="which columns are what: a kept profile, or TOML")
    taking.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="FIELD=VALUE",
        help="change the profile, as voltages='Cell {n} V', current='Pack I', charge_positive=true",
    )
    taking.add_argument("--save-profile", metavar="NAME", help="keep the profile under this name")
    taking.add_argument("--name", default="", help="what to call the session (default: the file's name)")
    taking.add_argument("--start", metavar="TIME", help="when it began, ISO 8601, where the file does not say")
    taking.add_argument("--filter", choices=FILTERS, default="fused", help="state estimator (default: fused)")
    taking.add_argument(
        "--cell", metavar="CELL.toml", help="cell file or name of a bundled one (default: the battery's)"
    )
