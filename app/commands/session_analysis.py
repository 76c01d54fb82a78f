"""`voltwall sessions laps` and what else looks back on a session."""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from app.commands.arguments import Actions, add_json_argument, add_session_argument, find_session, new_action
from app.commands.console import Progress, print_table
from app.errors import ConfigError
from app.words import RenderedMessage, place_of

if TYPE_CHECKING:
    from app.analysis.laps.figures import DriverFigures, Lap
    from app.analysis.laps.from_session import Counter, LapTable
    from app.sessions.reading.reader import SessionFile

_NUMBER = r"(0[xX][0-9a-fA-F]+|[0-9]+)"
_COUNTER = re.compile(f"can:{_NUMBER}:{_NUMBER}(?::{_NUMBER})?")


def add_arguments(actions: Actions) -> None:
    """Declare the actions."""
    text = "show the laps of a session: energy, power, SOC, temperature, weakest cell, drivers"
    laps = new_action(actions, "laps", text, show_laps)
    text = "show the black box of each trip and fault of a session"
    boxes = new_action(actions, "blackbox", text, show_black_boxes)
    report = new_action(
        actions, "report", "show the report of a session: limits reached, recommended checks", show_report
    )
    compare = new_action(actions, "compare", "compare two sessions", show_comparison)
    for action in (laps, boxes, report, compare):
        add_session_argument(action)
        add_json_argument(action)
    laps.add_argument(
        "--laps-from",
        metavar="WHERE",
        help="source of the laps: settled (saved), markers, pattern (power profile), or a lap counter:\n"
        "can:ID:BYTE[:MASK], dbc:[MESSAGE.]SIGNAL with --dbc, or signal:NAME of the session, such as\n"
        "signal:charger.flags (default: the first available of settled, markers, pattern)",
    )
    laps.add_argument("--dbc", type=Path, metavar="FILE", help="DBC of the CAN frames")
    boxes.add_argument("--html", type=Path, metavar="FOLDER", help="write each as HTML into this folder")
    report.add_argument(
        "--html", type=Path, metavar="FOLDER", help="write the report with charts as HTML into this folder"
    )
    compare.add_argument("--with", dest="other", required=True, metavar="SESSION", help="other session, ID or file")


@contextmanager
def _opened(args: argparse.Namespace, name: str) -> Iterator[SessionFile]:
    """A session that is read as a whole; the terminal shows how far that is."""
    from app.sessions.reading.reader import SessionFile

    path = find_session(args, name)
    with Progress(path.stem) as progress, SessionFile(path, progress) as session:
        yield session


def show_laps(args: argparse.Namespace) -> int:
    """Print the laps."""
    from app.analysis.laps.from_session import lap_table

    with _opened(args, args.session) as session:
        source, counter = _source(args.laps_from, session, args.dbc)
        table = lap_table(session, source, counter)  # type: ignore[arg-type]
        start_s = session.info.started_wall_ns / 1e9
    if args.json:
        print(json.dumps(asdict(table), indent=2))
    else:
        _print_laps(table, start_s, session.battery.segments)
    return 0


def show_report(args: argparse.Namespace) -> int:
    """Print how a session went."""
    from app.analysis.document import document
    from app.analysis.report.report import report_of

    with _opened(args, args.session) as session:
        report = report_of(session)
    if args.json:
        print(json.dumps(asdict(report), indent=2))
    else:
        findings = report.findings
        print(findings.headline.text)
        parts = (
            ("Why", findings.why),
            ("Limits reached", findings.limited),
            ("Recommended checks", findings.recommended_checks),
        )
        for title, sentences in parts:
            if not sentences:
                continue
            print(f"\n{title}")
            for text in _texts(sentences):
                print(f"  {text}")
    if args.html is not None:
        _write(args.html / f"{report.session.id}-report.html", document(report))
    return 0


def _write(path: Path, page: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(page, encoding="utf-8")
    print(path, file=sys.stderr)


def show_comparison(args: argparse.Namespace) -> int:
    """Print two sessions side by side."""
    from app.analysis.report.report import compare_sessions

    with _opened(args, args.session) as session, _opened(args, args.other) as other:
        comparison = compare_sessions(session, other)
    if args.json:
        shown = {
            "a": comparison.a.figures,
            "b": comparison.b.figures,
            "cells": [asdict(cell) for cell in comparison.cells],
            "judged": {"a": _texts(comparison.a.judged), "b": _texts(comparison.b.judged)},
            "unlike": _texts(comparison.unlike),
        }
        print(json.dumps(shown, indent=2))
        return 0
    rows = []
    for name, a in comparison.a.figures.items():
        b = comparison.b.figures[name]
        rows.append((name, _figure(a), _figure(b), "" if a is None or b is None else f"{b - a:+.5g}"))
    print_table(("", comparison.a.id, comparison.b.id, "difference"), rows, "<>>>")
    for cell in comparison.cells:
        place = short_place(cell.cell, session.battery.segments)
        print(f"cell {place}: resistance {100 * cell.change:+.1f} % against the others")
    for text in _texts(comparison.unlike):
        print(text)
    return 0


def _texts(findings: Sequence[RenderedMessage]) -> list[str]:
    return [finding.text for finding in findings]


def _figure(value: float | None) -> str:
    return "-" if value is None else f"{value:.5g}"


def show_black_boxes(args: argparse.Namespace) -> int:
    """Print what happened around every trip and fault."""
    from app.analysis.black_box.from_session import boxes_of
    from app.analysis.document import document

    with _opened(args, args.session) as session:
        boxes = boxes_of(session)
    if args.json:
        print(json.dumps([asdict(box) for box in boxes]))
    for box in boxes:
        if not args.json:
            print(f"{box.id}\n  " + "\n  ".join(_texts(box.findings)))
        if args.html is not None:
            _write(args.html / f"{box.id}.html", document(box))
    if not boxes and not args.json:
        print("no trip and no fault")
    return 0


def _source(text: str | None, session: SessionFile, dbc: Path | None) -> tuple[str | None, Counter | None]:
    if text is None or text in ("settled", "markers", "pattern"):
        return text, None
    if text.startswith("signal:"):
        return "signal", text.removeprefix("signal:")
    if text.startswith("dbc:"):
        from app.analysis.laps.from_session import CounterSamples
        from app.sources.recordings.log_signals import one_signal

        if dbc is None:
            raise ConfigError("--dbc", "(none)", "the DBC file that names the signal")
        frames = ((session.unix_s(f.t_mono_ns), f.can_id, f.data) for f in session.can_frames())
        return "can", CounterSamples(*one_signal(frames, session.info.id, dbc, text.removeprefix("dbc:")))
    from app.analysis.laps.from_session import CanCounter

    match = _COUNTER.fullmatch(text)
    if match is None:
        raise ConfigError(
            "--laps-from", text, "settled, markers, pattern, can:ID:BYTE[:MASK], dbc:SIGNAL or signal:NAME"
        )
    can_id, byte, mask = (None if part is None else int(part, 0) for part in match.groups())
    return "can", CanCounter(can_id or 0, byte or 0, 0xFF if mask is None else mask)


def _print_laps(table: LapTable, start_s: float, segments: Sequence[int]) -> None:
    print(f"laps from: {table.source}")
    heads = ["lap", "at s", "time s", "out Wh", "in Wh", "mean kW", "max kW", "SOC %", "rise K"]
    rows = [
        (
            str(lap_number),
            f"{lap.lap.start_s - start_s:.1f}",
            f"{lap.lap.duration_s:.2f}",
            scaled(lap.energy_out_wh, 1, 1),
            scaled(lap.energy_in_wh, 1, 1),
            scaled(lap.power_mean_w, 1e-3, 2),
            scaled(lap.power_max_w, 1e-3, 1),
            scaled(lap.soc_used, 100, 2),
            scaled(lap.temperature_rise_k, 1, 1),
            _cell(lap.temperature_max_cell, lap.temperature_max_degc, 0, "degC", segments),
            _cell(lap.weakest_cell, lap.voltage_min_v, 3, "V", segments),
            _notes(lap.lap),
        )
        for lap_number, lap in enumerate(table.laps, 1)
    ]
    print_table([*heads, "hottest", "lowest cell", "driver"], rows, ">>>>>>>>><<<")
    if len(table.drivers) > 1 or any(driver.driver for driver in table.drivers):
        print()
        heads = ["driver", "laps", "mean s", "best s", "spread s", "out Wh", "in Wh", "mean kW", "SOC %", "rise K"]
        print_table(heads, [_of_driver(one) for one in table.drivers], "<>>>>>>>>>")


def _notes(lap: Lap) -> str:
    partial = "(partial)" if lap.is_partial else ""
    return " ".join(part for part in (lap.driver, lap.note, partial, "" if lap.counts else "(not counted)") if part)


def _of_driver(one: DriverFigures) -> tuple[str, ...]:
    return (
        one.driver or "(not named)",
        str(one.laps),
        f"{one.lap_s:.2f}",
        f"{one.best_lap_s:.2f}",
        f"{one.lap_spread_s:.2f}",
        scaled(one.energy_out_wh, 1, 1),
        scaled(one.energy_in_wh, 1, 1),
        scaled(one.power_mean_w, 1e-3, 2),
        scaled(one.soc_used, 100, 2),
        scaled(one.temperature_rise_k, 1, 1),
    )


def scaled(value: float | None, factor: float, decimals: int) -> str:
    """Return a number times a factor; a dash where there is none."""
    return "-" if value is None else f"{value * factor:.{decimals}f}"


def short_place(cell: int, segments: Sequence[int]) -> str:
    """Pack and cell as 3/7, for where there is little room."""
    return "/".join(map(str, place_of(cell, segments) or (cell + 1,)))


def _cell(cell: int | None, value: float | None, decimals: int, unit: str, segments: Sequence[int]) -> str:
    place = "" if cell is None else short_place(cell, segments)
    return f"{place} {value:.{decimals}f} {unit}".strip() if value is not None else place or "-"
