"""`voltwall season`: what many sessions say together."""

import argparse
from pathlib import Path

from app.commands.arguments.common import (
    add_car_arguments,
    add_data_argument,
    add_json_argument,
    add_session_argument,
    new_action,
)
from app.commands.arguments.work import Work
from app.commands.console.number import between
from app.estimation.filters.filter_names import FILTERS
from app.season.store.questions import parameters_of, questions
from app.season.tags import NAMES


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the actions."""
    add_data_argument(parser)
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    for add in (_add_build, _add_query, _add_report, _add_swap, _add_estimate, _add_simulate):
        add(actions)


def _add_build(actions: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the action."""
    build = new_action(
        actions, "build", "make the season lake from closed sessions: what is new or has changed", "season.build.build"
    )
    build.add_argument(
        "places",
        metavar="DIR",
        nargs="*",
        type=Path,
        help="folders of sessions, or session files (default: the data folder's)",
    )
    add_lake_argument(build)
    build.add_argument("--again", action="store_true", help="make all anew, what is up to date too")
    build.add_argument("--judge", action="store_true", help="judge the cells of each session anew (slower)")


def _add_query(actions: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the action."""
    query = new_action(
        actions,
        "query",
        "answer SQL over the lake: one SELECT, or a question by its name",
        "season.query.answer_question",
    )
    lines = "\n".join(f"  {each.name:16} {each.meaning}{parameters_of(each)}" for each in questions())
    query.epilog = (
        "Tables: sessions, laps, cells, events, samples; columns: docs/reference/season-lake.md.\n\nQuestions:\n"
        + lines
    )
    query.add_argument(
        "question",
        metavar="SQL|NAME",
        nargs="?",
        help='as "SELECT car, min(voltage_min_v) FROM cells GROUP BY 1"; without it the questions are listed',
    )
    query.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="a parameter of a question")
    query.add_argument("--show", action="store_true", help="print the SQL of a question instead of its answer")
    add_lake_argument(query)
    query.add_argument("--limit-rows", type=int, default=1000, metavar="N", help="rows at most (default: %(default)s)")
    query.add_argument(
        "--limit-s", type=float, default=60.0, metavar="S", help="seconds at most (default: %(default)s)"
    )
    query.add_argument("--limit-mb", type=int, default=1024, metavar="MB", help="memory at most (default: %(default)s)")
    query.add_argument("--csv", action="store_true", help="as CSV")
    add_json_argument(query)


def _add_report(actions: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the actions."""
    text = "trends of the accumulator and its cells, ranking with reasons"
    report = new_action(actions, "report", text, "season.report.show_report")
    report.add_argument("--html", type=Path, metavar="FOLDER", help="write the season report, to print")
    report.add_argument("--sessions", default="", metavar="WORDS", help="of the sessions that match alone")
    _add_season_arguments(report)
    tag = new_action(actions, "tag", "set the tags of a session; they are kept in its file", "season.report.tag")
    add_session_argument(tag)
    for name in NAMES:
        tag.add_argument(f"--{name}", metavar="TEXT", help="empty: take it away")


def _add_swap(actions: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the action."""
    swap = new_action(
        actions,
        "swap",
        "swaps of modules: list them, record one, take one back; a swapped module inherits nothing",
        "season.swap.swap_modules",
    )
    swap.add_argument(
        "cells", metavar="CELLS", nargs="?", help="record that these were replaced: pack/cell, such as 3/7,3/8"
    )
    swap.add_argument("--at", metavar="TIME", help="when, such as 2026-07-14T10:30 (UTC; default: now)")
    swap.add_argument("--note", default="", help="about the swap")
    swap.add_argument("--take-back", type=int, metavar="NUMBER", help="remove the swap of this number")
    _add_season_arguments(swap)


def _add_estimate(actions: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the action."""
    text = "all sessions through the filter again, in parallel; the new results beside the old, and what changed"
    parser = actions.add_parser(
        "estimate",
        help=text,
        description=text[0].upper() + text[1:] + ".",
        formatter_class=argparse.RawTextHelpFormatter,
    )
    parser.add_argument(
        "folder", type=Path, metavar="DIR", help="data folder: its sessions/, or itself if they lie in it"
    )
    parser.add_argument(
        "--cell", default="session", metavar="CELL.toml", help="cell file or bundled cell (default: each session's own)"
    )
    parser.add_argument("--filter", choices=FILTERS, default="fused", help="default: %(default)s")
    parser.add_argument(
        "--against",
        default="session",
        metavar="CELL.toml",
        help="compare with this cell file, estimated too where it was not yet\n(default: each session's own; none: "
        "with what was recorded alone)",
    )
    parser.add_argument(
        "--engine",
        default="processes",
        metavar="URL",
        help="processes (default), or dask://HOST:PORT: a Dask scheduler",
    )
    parser.add_argument("--processes", type=int, metavar="N", help="of the pool (default: one a core)")
    parser.add_argument("--again", action="store_true", help="also sessions of which there is a result already")
    parser.add_argument("--json", action="store_true", help="as JSON")
    parser.set_defaults(do=Work("season.estimate.estimate"))


def _add_simulate(actions: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the action."""
    parser = new_action(
        actions,
        "simulate",
        "a season of simulated sessions that ends today, in and between which the cells age",
        "season.simulate.simulate",
    )
    parser.add_argument("--sessions", type=int, default=12, metavar="N", help="how many (default: %(default)s)")
    parser.add_argument(
        "--days", type=between(1, 3650, "days"), default=240.0, help="from the first to the last (default: %(default)g)"
    )
    parser.add_argument(
        "--drive-s",
        type=between(30, 7200, "s"),
        default=420.0,
        metavar="S",
        help="of driving in each, between two rests (default: %(default)g)",
    )
    parser.add_argument(
        "--use-ah",
        type=between(0, 1000, "Ah"),
        default=40.0,
        metavar="AH",
        help="passed through each cell from one session to the next, out and in (default: %(default)g)",
    )
    parser.add_argument(
        "--pace",
        action="append",
        default=[],
        metavar="PACK/CELL=TIMES",
        help="a cell that ages so many times faster, as 3/7=4; may be given again",
    )
    parser.add_argument("--seed", type=int, default=25, metavar="N", help="of the cells (default: %(default)s)")
    parser.add_argument(
        "--speed", type=between(1, 100, "times real time"), default=10.0, help="times real time (default: %(default)g)"
    )


def _add_season_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare whose season is meant, and --json."""
    add_car_arguments(parser)
    parser.add_argument("--car", default="", metavar="NAME", help="of this car alone (default: of each, never mixed)")
    add_lake_argument(parser)
    add_json_argument(parser, default=False)


def add_lake_argument(parser: argparse.ArgumentParser) -> None:
    """Declare --lake."""
    parser.add_argument(
        "--lake", metavar="DIR|URL", help="the lake: a folder, or a URL of fsspec (default: lake in the data folder)"
    )
