"""`voltwall season`: what many sessions say together."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from app.clock import Clock
from app.commands import season_estimate, season_simulate
from app.commands.arguments import (
    Actions,
    add_data_argument,
    add_json_argument,
    add_session_argument,
    catalogue,
    chosen_battery,
    data_folder,
    find_session,
    new_action,
    unix_s,
)
from app.commands.console import Progress, print_table
from app.commands.session_analysis import short_place
from app.errors import ConfigError
from app.season.store.questions import ask, find_question, json_of, parameters_of, questions
from app.season.tags import NAMES, matches, write_tags
from app.words import render

if TYPE_CHECKING:
    from app.battery.battery import Battery
    from app.season.history import SeasonSource
    from app.season.lake.build import Built
    from app.season.lake.place import LakeFolder
    from app.season.overview import SeasonOverview
    from app.season.store import Answer
    from app.season.trends import SeasonTrend

SHOWN = 10
QUANTITIES = {
    "resistance": "of new",
    "capacity": "of new",
    "spread": "between cells",
    "soc_spread": "at rest",
    "self_discharge": "a day",
}
MOST_DIGITS = 9  # digits of a pack's or a cell's number


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the actions."""
    add_data_argument(parser)
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    for add in (_add_build, _add_query, _add_report, _add_swap):
        add(actions)
    for part in (season_estimate, season_simulate):
        part.add_arguments(actions)


def _add_build(actions: Actions) -> None:
    """Declare the action."""
    text = "update the season data from new or changed sessions"
    parser = new_action(actions, "build", text, build)
    parser.add_argument(
        "places",
        metavar="DIR",
        nargs="*",
        type=Path,
        help="session folders or files (default: the data folder)",
    )
    add_lake_argument(parser)
    parser.add_argument("--again", action="store_true", help="rebuild everything")
    parser.add_argument("--judge", action="store_true", help="re-evaluate the cells of each session (slower)")


def _add_query(actions: Actions) -> None:
    """Declare the action."""
    text = "run an SQL query or a named query on the season data"
    query = new_action(actions, "query", text, answer_question)
    lines = "\n".join(f"  {question.name:16} {question.meaning}{parameters_of(question)}" for question in questions())
    tables = "Tables: sessions, laps, cells, events, samples; columns: docs/reference/season-lake.md."
    query.epilog = f"{tables}\n\nNamed queries:\n{lines}"
    query.add_argument(
        "question",
        metavar="SQL|NAME",
        nargs="?",
        help='SQL such as "SELECT car, min(voltage_min_v) FROM cells GROUP BY 1",\n'
        "or a named query (default: list them)",
    )
    query.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="parameter of a named query")
    query.add_argument("--show", action="store_true", help="print the SQL of a named query")
    add_lake_argument(query)
    query.add_argument(
        "--limit-rows", type=int, default=1000, metavar="N", help="maximum number of rows (default: %(default)s)"
    )
    query.add_argument("--limit-s", type=float, default=60.0, metavar="S", help="time limit (default: %(default)s)")
    query.add_argument("--limit-mb", type=int, default=1024, metavar="MB", help="memory limit (default: %(default)s)")
    query.add_argument("--csv", action="store_true", help="print CSV")
    add_json_argument(query)


def _add_report(actions: Actions) -> None:
    """Declare the actions."""
    text = "show trends of the accumulator and its cells, with the weakest cells"
    report = new_action(actions, "report", text, show_report)
    report.add_argument("--html", type=Path, metavar="FOLDER", help="write the season report as HTML into this folder")
    report.add_argument("--sessions", default="", metavar="WORDS", help="only sessions that match these words")
    _add_season_arguments(report)
    tagging = new_action(actions, "tag", "set the tags of a session", tag)
    add_session_argument(tagging)
    for name in NAMES:
        tagging.add_argument(f"--{name}", metavar="TEXT", help="tag value, empty to remove it")


def _add_swap(actions: Actions) -> None:
    """Declare the action."""
    text = "list, record or remove module swaps"
    swap = new_action(actions, "swap", text, swap_modules)
    swap.add_argument(
        "cells", metavar="CELLS", nargs="?", help="replaced cells as pack/cell, such as 3/7,3/8 (default: list swaps)"
    )
    swap.add_argument("--at", metavar="TIME", help="time of the swap, such as 2026-07-14T10:30 (UTC, default: now)")
    swap.add_argument("--note", default="", help="note")
    swap.add_argument("--take-back", type=int, metavar="NUMBER", help="remove the swap with this number")
    _add_season_arguments(swap)


def _add_season_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare whose season is meant, and --json."""
    parser.add_argument("--battery", metavar="NAME|FILE", help="battery profile (default: that of the service)")
    parser.add_argument("--simulated", action="store_true", help="use simulated sessions")
    parser.add_argument("--car", default="", metavar="NAME", help="only this car (default: each car separately)")
    add_lake_argument(parser)
    add_json_argument(parser, default=False)


def add_lake_argument(parser: argparse.ArgumentParser) -> None:
    """Declare --lake."""
    parser.add_argument(
        "--lake", metavar="DIR|URL", help="season data: folder or fsspec URL (default: lake in the data folder)"
    )


def build(args: argparse.Namespace) -> int:
    """Make the lake; 1 where a session was left out.

    Raises:
        ConfigError: the lake cannot be written.
    """
    from app.season.lake.place import LakeFolder

    places = args.places or [data_folder(args) / "sessions"]
    for place in places:
        if not place.exists():
            raise ConfigError("DIR", place, "a folder of sessions, or a session")
    lake = LakeFolder(lake_of(args))
    built = built_lake(lake, places, again=args.again, judge_anew=args.judge)
    print(f"{lake.url}: {len(built.made)} made, {len(built.current)} up to date")
    if built.not_closed:
        print(f"not closed yet: {', '.join(built.not_closed)}")
    return 1 if built.failed else 0


def lake_of(args: argparse.Namespace) -> str:
    """Return where the lake of an action is."""
    from app.service.settings import Settings

    return str(args.lake or Settings().lake or data_folder(args) / "lake")


def built_lake(lake: LakeFolder, places: Sequence[Path], *, again: bool = False, judge_anew: bool = False) -> Built:
    """Bring a lake up to date with the sessions of folders; name those left out, and on a terminal show how far it is.

    Raises:
        ConfigError: the lake cannot be written.
    """
    from app.season.lake.build import build_lake, session_files

    try:
        with Progress("season lake") as line:
            files = session_files(places)
            built = build_lake(
                lake, files, again=again, judge_anew=judge_anew, progress=lambda done, of, _: line(done, of)
            )
    except OSError as error:
        raise ConfigError("lake", lake.url, error.strerror or str(error)) from error
    for session, why in built.failed:
        print(f"{session} is left out: {render(why)}", file=sys.stderr)
    return built


def kept_season(args: argparse.Namespace) -> SeasonSource:
    """Bring the lake up to date with the data folder, and return its season.

    Raises:
        AppError: the data folder, the lake, the battery or its cell file cannot be used.
    """
    from app.season.history import SeasonSource
    from app.season.lake.place import LakeFolder
    from app.sessions.swaps import SwapFile

    battery, cell = chosen_battery(args)
    folder, lake = data_folder(args), lake_of(args)
    if (folder / "sessions").is_dir():
        built_lake(LakeFolder(lake), [folder / "sessions"])
    swaps = SwapFile(folder, battery, simulated=args.simulated).read()
    return SeasonSource(lake, battery, args.simulated, cell, tuple(swaps))


def answer_question(args: argparse.Namespace) -> int:
    """Print the answer.

    Raises:
        AppError: the question is wrong, not allowed, or takes too long.
    """
    from app.season.lake.place import LakeFolder
    from app.season.store import QueryLimits, SeasonStore

    if args.question is None:
        if getattr(args, "json", False):
            print(json.dumps([asdict(question) for question in questions()], indent=2))
        else:
            print_table((), [(question.name, question.meaning + parameters_of(question)) for question in questions()])
        return 0
    if args.show and (question := find_question(args.question)) is not None:
        print(question.sql, end="")
        return 0
    for option, least in (("limit_rows", 0), ("limit_s", 0.001), ("limit_mb", 16)):
        if not getattr(args, option) >= least:
            raise ConfigError(option.replace("_", "-"), getattr(args, option), f"at least {least}")
    limits = QueryLimits(args.limit_s, args.limit_mb, args.limit_rows)
    lake = lake_of(args)
    if args.lake:
        LakeFolder(lake).check_there()
    answer = ask(SeasonStore(lake), args.question, limits, **dict(_pair(text) for text in args.set))
    _print_answer(args, answer)
    if answer.is_cut and not getattr(args, "json", False):
        print(f"cut after {args.limit_rows} rows: --limit-rows", file=sys.stderr)
    return 0


def _pair(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals:
        raise ConfigError("set", text, "NAME=VALUE")
    return name, value


def _print_answer(args: argparse.Namespace, answer: Answer) -> None:
    from app.sessions.export.csv_file import csv_row

    names, rows = answer.table.column_names, answer.rows()
    if getattr(args, "json", False):
        print(json_of(answer))
    elif args.csv:
        sys.stdout.writelines(map(csv_row, [names, *rows]))
    else:
        print_table(names, [[_cell(value) for value in row] for row in rows])


def _cell(value: object) -> str:
    return "" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)


def show_report(args: argparse.Namespace) -> int:
    """Print the season's report."""
    from app import __version__
    from app.season.report import season_document, season_report

    source = kept_season(args)
    chosen = [info for info in reversed(catalogue(args).list()) if matches(info, args.sessions)]
    report = season_report(source.battery, source.histories(args.car), chosen, Clock().wall_s(), __version__)
    if args.json:
        print(json.dumps(asdict(report), allow_nan=False))
    else:
        print(f"{report.battery}: {len(report.sessions)} sessions")
        for car in report.cars:
            _print_car(car.overview, source.battery.segments)
    if args.html is not None:
        args.html.mkdir(parents=True, exist_ok=True)
        path = args.html / "season-report.html"
        path.write_text(season_document(report), encoding="utf-8")
        print(path, file=sys.stderr)
    return 0


def _print_car(overview: SeasonOverview, segments: Sequence[int]) -> None:
    print(f"{overview.car}: {overview.sessions} sessions, {overview.charge_ah:.0f} Ah passed")
    for group in overview.groups:
        print("accumulator" if group.pack is None else f"pack {group.pack + 1}")
        for name, unit in QUANTITIES.items():
            if name == "resistance" and not overview.is_absolute:
                unit = "of the median cell"
            _print_trend(name.replace("_", " "), getattr(group, name), unit)
    for cell in overview.cells[:SHOWN]:
        if cell.reasons:
            print(f"{short_place(cell.cell, segments):6} {'; '.join(reason.text for reason in cell.reasons)}")
            _print_trend("resistance", cell.resistance_trend, "of the median cell")
            _print_trend("capacity", cell.capacity_trend, "of the median cell")
            _print_trend("self discharge", cell.self_discharge_trend, "a day beyond the median cell", 3)


def _print_trend(name: str, trend: SeasonTrend | None, unit: str, digits: int = 2) -> None:
    if trend is None:
        print(f"  {name:15} too few sessions")
        return
    if trend.is_reportable:
        sure = "" if trend.is_sure else " (not more than chance)"
        band = f"95 % {100 * trend.low:+.3f}..{100 * trend.high:+.3f}"
        month = f"{100 * trend.per_month:+.3f} % a month, {band}{sure}"
    else:
        month = "too few days to tell what a month changes"
    print(f"  {name:15} {100 * trend.now:.{digits}f} % {unit}, {month}, {trend.sessions} sessions")


def tag(args: argparse.Namespace) -> int:
    """Set tags and print what is kept."""
    tags = {name: text for name in NAMES if (text := getattr(args, name)) is not None}
    if not tags:
        raise ConfigError("tag", "(nothing)", ", ".join(f"--{name}" for name in NAMES))
    path = find_session(args, args.session)
    print(json.dumps(write_tags(path, tags, t_wall_ns=Clock().wall_ns(), who=None)))
    return 0


def swap_modules(args: argparse.Namespace) -> int:
    """Record a swap, or take one back, where that is asked for; print those of the car, or of all."""
    from app.sessions.swaps import SwapFile

    source = kept_season(args)
    swaps = SwapFile(data_folder(args), source.battery, simulated=args.simulated)
    if args.take_back is not None and not swaps.remove(args.take_back):
        raise ConfigError("--take-back", args.take_back, "the number of a swap that is listed")
    if args.cells is not None:
        cells = [cell_index(source.battery, part) for part in args.cells.split(",")]
        cars = [history.car for history in source.histories()]
        at_s = Clock().wall_s() if args.at is None else unix_s("--at", args.at)
        swaps.add(cells, at_s, args.note, None, args.car, cars)
    listed = [swap for swap in swaps.read() if not args.car or swap.is_of(args.car)]
    if args.json:
        print(json.dumps([asdict(swap) for swap in listed]))
        return 0
    for swap in listed:
        when = datetime.fromtimestamp(swap.time_s, UTC).strftime("%Y-%m-%d %H:%MZ")
        cells_text = ", ".join(short_place(cell, source.battery.segments) for cell in swap.cells)
        whose = "" if swap.car is None else f" of {swap.car}"
        print(f"swap {swap.id}: {cells_text}{whose} replaced {when}" + (f": {swap.note}" if swap.note else ""))
    return 0


def cell_index(battery: Battery, text: str) -> int:
    """Return the index of a cell named PACK/CELL.

    Raises:
        ConfigError: the battery has no such cell.
    """
    pack, _, cell = text.strip().partition("/")
    is_place = all(part.isascii() and part.isdecimal() and len(part) <= MOST_DIGITS for part in (pack, cell))
    index = battery.cell_at(int(pack) - 1, int(cell) - 1) if is_place else None
    if index is None:
        raise ConfigError("CELLS", text, f"pack/cell, 1/1 to {battery.n_packs}/{battery.segments[-1]}")
    return index
