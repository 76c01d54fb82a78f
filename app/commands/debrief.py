"""`voltwall sessions laps` and what else looks back on a session."""

import argparse
import json
import re
import sys
import time
from collections.abc import Callable
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path

from app.analysis.blackbox import short_place
from app.analysis.passport import latest
from app.analysis.totals import number
from app.debrief.blackbox import black_boxes
from app.debrief.blackbox_page import blackbox_page
from app.debrief.laps import CanCounter, LapTable, lap_table
from app.debrief.passport import PassportKeeper
from app.debrief.report import compare_sessions, histogram_json, report_of
from app.debrief.report_page import report_page
from app.errors import ConfigError
from app.estimation.cellfile import load_cell
from app.estimation.errors import EstimatorError
from app.sessions.catalogue import Catalogue
from app.sessions.reader import SessionFile
from firmware_protocol.memory_map import CELLS_PER_PACK, N_PACKS

_NUMBER = r"(0[xX][0-9a-fA-F]+|[0-9]+)"
_COUNTER = re.compile(f"can:{_NUMBER}:{_NUMBER}(?::{_NUMBER})?")
ACTIONS = ("laps", "blackbox", "report", "compare")
OF_ALL = ("passport",)
HELP = (
    "laps     its laps: energy, power, charge, heat, weakest cell; drivers compared\n"
    "blackbox what happened around every trip and fault; with --html a page to print for each\n"
    "report   how it went, what limited, what to look at; with --html the whole report with charts\n"
    "compare  two sessions side by side: give the other one with --with\n"
    "passport every cell across all sessions: capacity, resistance, self-discharge, balancing, rank, drift;\n"
    "         --swap 3/7,3/8 records that these modules were replaced (now, or --at TIME), with --note\n"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what only these actions take."""
    parser.add_argument(
        "--laps-from",
        metavar="WHERE",
        help="laps: settled, markers, pattern, or can:ID:BYTE[:MASK], a byte that goes up when a lap begins\n"
        "(default: the first of them that there is)",
    )
    parser.add_argument("--html", type=Path, metavar="FOLDER", help="blackbox, report: write pages to print")
    parser.add_argument("--with", dest="other", metavar="SESSION", help="compare: the other session's id or file")
    parser.add_argument("--swap", metavar="CELLS", help="passport: pack/cell of swapped modules, as 3/7,3/8")
    parser.add_argument("--at", metavar="TIME", help="passport: when they were swapped, as 2026-07-14T10:30 (UTC)")
    parser.add_argument("--simulated", action="store_true", help="passport: of the simulated car")
    parser.add_argument("--note", default="", help="passport: about the swap")


def run(args: argparse.Namespace, session: SessionFile, find_session: Callable[[Path | None, str], Path]) -> int:
    """Do what was asked for.

    Raises:
        ConfigError: an argument cannot be used.
    """
    if args.action == "blackbox":
        return _black_boxes(args, session)
    if args.action == "report":
        return _report(args, session)
    if args.action == "compare":
        return _compare(args, session, find_session)
    source, counter = _source(args.laps_from)
    table = lap_table(session, source, counter)  # type: ignore[arg-type]
    if args.json:
        json.dump(asdict(table), sys.stdout, indent=2)
        print()
    else:
        _print_laps(table, session.info.started_wall_ns / 1e9)
    return 0


def _report(args: argparse.Namespace, session: SessionFile) -> int:
    report = report_of(session)
    if args.json:
        shown = {"headline": report.headline, "limited": report.limited, "look_at": report.look_at}
        histograms = {name: histogram_json(histogram) for name, histogram in report.survey.histograms.items()}
        json.dump(shown | {"figures": report.figures, "histograms": histograms}, sys.stdout, indent=2)
        print()
    else:
        print(report.headline)
        for title, sentences in (("What limited", report.limited), ("What to look at", report.look_at)):
            print(f"\n{title}")
            for sentence in sentences:
                print(f"  {sentence}")
    if args.html is not None:
        args.html.mkdir(parents=True, exist_ok=True)
        path = args.html / f"{report.info.id}-report.html"
        path.write_text(report_page(report), encoding="utf-8")
        print(path, file=sys.stderr)
    return 0


def _compare(args: argparse.Namespace, session: SessionFile, find_session: Callable[[Path | None, str], Path]) -> int:
    if args.other is None:
        raise ConfigError("--with", "(none)", "the session to compare with")
    with SessionFile(find_session(args.data, args.other)) as other:
        found = compare_sessions(session, other)
    if args.json:
        figures = {"a": found.figures_a, "b": found.figures_b}
        json.dump(figures | {"cells": found.cells}, sys.stdout, indent=2)
        print()
        return 0
    print(f"{'':24} {found.a.id:>22} {found.b.id:>22}  difference")
    for name, a in found.figures_a.items():
        b = found.figures_b[name]
        difference = "" if a is None or b is None else f"{b - a:+.5g}"
        print(f"{name:24} {_figure(a):>22} {_figure(b):>22}  {difference}")
    for cell in found.cells:
        print(f"cell {_cell(cell['cell'], None, 0, '')}: resistance {100 * cell['change']:+.1f} % against the others")
    return 0


def _figure(value: float | None) -> str:
    return "-" if value is None else f"{value:.5g}"


def _black_boxes(args: argparse.Namespace, session: SessionFile) -> int:
    boxes = black_boxes(session)
    if args.json:
        json.dump(boxes, sys.stdout)
        print()
    for box in boxes:
        if not args.json:
            print(f"{box['id']}\n  " + "\n  ".join(box["summary"]))
        if args.html is not None:
            args.html.mkdir(parents=True, exist_ok=True)
            path = args.html / f"{box['id']}.html"
            path.write_text(blackbox_page(box), encoding="utf-8")
            print(f"  {path}", file=sys.stderr)
    if not boxes and not args.json:
        print("no trip and no fault")
    return 0


def _source(text: str | None) -> tuple[str | None, CanCounter | None]:
    if text is None or text in ("settled", "markers", "pattern"):
        return text, None
    match = _COUNTER.fullmatch(text)
    if match is None:
        raise ConfigError("--laps-from", text, "settled, markers, pattern or can:ID:BYTE[:MASK]")
    can_id, byte, mask = (None if part is None else int(part, 0) for part in match.groups())
    return "can", CanCounter(can_id or 0, byte or 0, 0xFF if mask is None else mask)


def _print_laps(table: LapTable, start_s: float) -> None:
    print(f"laps from: {table.source}")
    print(
        "lap    at s  time s  out Wh   in Wh  mean kW  max kW  SOC %   rise K  hottest          lowest cell      driver"
    )
    for lap_number, each in enumerate(table.laps, 1):
        lap = each.lap
        print(
            f"{lap_number:>3} {lap.start_s - start_s:>7.1f} {lap.duration_s:>7.2f} {each.energy_out_wh:>7.1f}"
            f" {each.energy_in_wh:>7.1f} {_of(each.power_mean_w, 1e-3, 8, 2)} {_of(each.power_max_w, 1e-3, 7, 1)}"
            f" {_of(each.soc_used, 100, 6, 2)} {_of(each.temperature_rise_k, 1, 8, 1)}"
            f"  {_cell(each.temperature_max_cell, each.temperature_max_degc, 0, 'degC'):16}"
            f" {_cell(each.weakest_cell, each.voltage_min_v, 3, 'V'):16}"
            f" {' '.join(part for part in (lap.driver, lap.note, '' if lap.counts else '(not counted)') if part)}"
        )
    if len(table.drivers) > 1 or any(driver.driver for driver in table.drivers):
        print("\ndriver               laps  mean s  best s  spread s  out Wh   in Wh  mean kW  SOC %   rise K")
        for one in table.drivers:
            print(
                f"{one.driver or '(not named)':20} {one.laps:>4} {one.lap_s:>7.2f} {one.best_lap_s:>7.2f}"
                f" {one.lap_spread_s:>9.2f} {one.energy_out_wh:>7.1f} {one.energy_in_wh:>7.1f}"
                f" {_of(one.power_mean_w, 1e-3, 8, 2)} {_of(one.soc_used, 100, 6, 2)}"
                f" {_of(one.temperature_rise_k, 1, 8, 1)}"
            )


def _of(value: float | None, factor: float, width: int, decimals: int) -> str:
    return f"{'-':>{width}}" if value is None else f"{value * factor:>{width}.{decimals}f}"


def _cell(cell: int | None, value: float | None, decimals: int, unit: str) -> str:
    place = "" if cell is None else short_place(cell)
    return f"{place} {value:.{decimals}f} {unit}".strip() if value is not None else place or "-"


def run_of_all(args: argparse.Namespace, data: Path, cell_name: str) -> int:
    """Show the cell passports, or record a swap.

    Raises:
        ConfigError: a cell, a time or the cell file cannot be used.
    """
    try:
        cell = load_cell(cell_name)
    except EstimatorError as error:
        raise ConfigError("cell", cell_name, str(error)) from error
    keeper = PassportKeeper(data, Catalogue(data / "sessions"), cell, simulated=args.simulated)
    try:
        if args.swap is not None:
            keeper.swap([_cell_index(part) for part in args.swap.split(",")], _time(args.at), args.note, None)
        keeper.read_new()
        made = keeper.passports()
    finally:
        keeper.close()
    names = ("capacity_ah", "resistance_ohm", "resistance_relative", "self_discharge_per_day", "balancing_h")
    now = {name: latest(getattr(made, name), made.line).tolist() for name in names}
    if args.json:
        known = {name: [number(value) for value in values] for name, values in now.items()}
        drifts = [asdict(drift) for drift in made.drifts]
        json.dump({"sessions": made.sessions, **known, "rank": made.rank.tolist(), "drifts": drifts}, sys.stdout)
        print()
        return 0
    print(f"{len(made.sessions)} sessions")
    for drift in made.drifts:
        print(f"{short_place(drift.cell)} {drift.text}")
    print("cell   rank  capacity Ah  resistance mohm  against others %  self-discharge %/day  bled h")
    for index in range(made.rank.size):
        ah, ohm, apart, rate, hours = (number(now[name][index]) for name in names)
        print(
            f"{short_place(index):5} {made.rank[index]:>5.0f} {_of(ah, 1, 12, 2)} {_of(ohm, 1000, 16, 3)}"
            f" {_of(apart, 100, 17, 1)} {_of(rate, 100, 21, 3)} {_of(hours, 1, 7, 1)}"
        )
    return 0


def _cell_index(text: str) -> int:
    pack, _, cell = text.strip().partition("/")
    if not (pack.isdigit() and cell.isdigit() and 1 <= int(pack) <= N_PACKS and 1 <= int(cell) <= CELLS_PER_PACK):
        raise ConfigError("--swap", text, f"pack/cell, 1/1 to {N_PACKS}/{CELLS_PER_PACK}")
    return (int(pack) - 1) * CELLS_PER_PACK + int(cell) - 1


def _time(text: str | None) -> float:
    if text is None:
        return time.time()
    try:
        at = datetime.fromisoformat(text)
    except ValueError as error:
        raise ConfigError("--at", text, f"a time as 2026-07-14T10:30: {error}") from error
    return (at if at.tzinfo else at.replace(tzinfo=UTC)).timestamp()
