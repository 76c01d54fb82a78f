"""`voltwall season report` and `tag`: what the season says of the cells, and tags that find sessions."""

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict

from app import __version__
from app.clock import Clock
from app.commands.season.kept import kept_season
from app.commands.session_commands.analysis import short_place
from app.commands.session_commands.selection import (
    catalogue,
    find_session,
)
from app.errors import ConfigError
from app.season.overview import SeasonOverview
from app.season.report import SeasonReport, season_document, season_report
from app.season.tags import NAMES, matches, write_tags
from app.season.trends import SeasonTrend

SHOWN = 10
QUANTITIES = {
    "resistance": "of new",
    "capacity": "of new",
    "spread": "between cells",
    "soc_spread": "at rest",
    "self_discharge": "a day",
}


def show_report(args: argparse.Namespace) -> int:
    """Print the season's report."""
    source = kept_season(args)
    chosen = [info for info in reversed(catalogue(args).list()) if matches(info, args.sessions)]
    report = season_report(source.battery, source.histories(args.car), chosen, Clock().wall_s(), __version__)
    if args.json:
        json.dump(asdict(report), sys.stdout, allow_nan=False)
        print()
    else:
        _print(report, source.battery.segments)
    if args.html is not None:
        args.html.mkdir(parents=True, exist_ok=True)
        path = args.html / "season-report.html"
        path.write_text(season_document(report), encoding="utf-8")
        print(path, file=sys.stderr)
    return 0


def _print(report: SeasonReport, segments: Sequence[int]) -> None:
    print(f"{report.battery}: {len(report.sessions)} sessions")
    for car in report.cars:
        _print_car(car.overview, segments)


def _print_car(found: SeasonOverview, segments: Sequence[int]) -> None:
    print(f"{found.car}: {found.sessions} sessions, {found.charge_ah:.0f} Ah passed")
    for group in found.groups:
        print("accumulator" if group.pack is None else f"pack {group.pack + 1}")
        for name, unit in QUANTITIES.items():
            if name == "resistance" and not found.is_absolute:
                unit = "of the median cell"
            _print_trend(name.replace("_", " "), getattr(group, name), unit)
    for each in found.cells[:SHOWN]:
        if each.reasons:
            print(f"{short_place(each.cell, segments):6} {'; '.join(reason.text for reason in each.reasons)}")
            _print_trend("resistance", each.resistance_trend, "of the median cell")
            _print_trend("capacity", each.capacity_trend, "of the median cell")
            _print_trend("self discharge", each.self_discharge_trend, "a day beyond the median cell", 3)


def _print_trend(name: str, trend: SeasonTrend | None, unit: str, digits: int = 2) -> None:
    if trend is None:
        print(f"  {name:15} too few sessions")
        return
    if trend.tells_month:
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
