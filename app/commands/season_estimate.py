"""`voltwall season estimate`: all sessions through the filter again, and what that changed."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from app.commands.arguments import Actions, chosen_cell, described
from app.commands.console import print_table
from app.commands.session_analysis import scaled
from app.errors import ConfigError
from app.estimation.filters.filter_names import FILTERS

if TYPE_CHECKING:
    from app.season.estimates.changes import EstimateChange
    from app.season.estimates.results import EstimateSet
    from app.season.estimates.run import EstimateProgress, Outcome
    from app.sessions.errors import SessionError
    from app.sessions.info import SessionInfo


def add_arguments(actions: Actions) -> None:
    """Declare the action."""
    text = "re-estimate all sessions in parallel and compare with the previous results"
    parser = actions.add_parser("estimate", **described(text), formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="DIR", help="data folder or session folder")
    parser.add_argument(
        "--cell",
        default="session",
        metavar="CELL.toml",
        help="cell file or bundled cell (default: that of each session)",
    )
    parser.add_argument("--filter", choices=FILTERS, default="fused", help="filter (default: %(default)s)")
    parser.add_argument(
        "--against",
        default="session",
        metavar="CELL.toml",
        help="compare with this cell file, estimated if needed\n(default: that of each session; none: "
        "with the recorded estimates only)",
    )
    parser.add_argument(
        "--engine",
        default="processes",
        metavar="URL",
        help="processes (default), or dask://HOST:PORT of a Dask scheduler",
    )
    parser.add_argument("--processes", type=int, metavar="N", help="number of processes (default: one per core)")
    parser.add_argument("--again", action="store_true", help="also sessions that already have results")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=estimate)


def estimate(args: argparse.Namespace) -> int:
    """Estimate all sessions and print what changed; 1 where one failed."""
    from app.season.estimates.changes import changes
    from app.season.estimates.results import Results
    from app.season.estimates.run import estimate_season, open_engine

    if args.processes is not None and args.processes < 1:
        raise ConfigError("--processes", args.processes, "at least 1")
    sessions, problems = _sessions(args.folder)
    results = Results(args.folder)
    after, text = _chosen(args.cell, "--cell", args.filter)
    wanted = [(after, text)]
    before = None
    if args.against != "none":
        before, other = _chosen(args.against, "--against", args.filter)
        if before != after:
            wanted.append((before, other))
    with open_engine(args.engine, args.processes) as engine:
        outcome = estimate_season(sessions, wanted, args.filter, results, engine, _show_progress, args.again)
    old = [] if before is None or before == after else results.read_all(before)
    session_ids = {info.id for info in sessions}
    changed = changes(old, [result for result in results.read_all(after) if result["session"] in session_ids])
    failed = {f"file {k}": str(error) for k, error in enumerate(problems, 1)} | outcome.failed
    if args.json:
        _print_json(after, before, outcome, failed, changed)
    else:
        _print_changes(changed)
        print(
            f"{len(outcome.estimated)} estimated in {outcome.took_s:.1f} s, {outcome.processor_s:.1f} s of processor; "
            f"{len(outcome.kept)} were there, {len(failed)} failed; in {results.folder / after.id}"
        )
        for name, reason in failed.items():
            print(f"{name}: {reason}", file=sys.stderr)
    return 1 if failed else 0


def _sessions(folder: Path) -> tuple[list[SessionInfo], Sequence[SessionError]]:
    """Finished sessions, the oldest first."""
    from app.sessions.catalogue import Catalogue

    if not folder.is_dir():
        raise ConfigError("DIR", str(folder), "a folder")
    inside = folder / "sessions"
    sessions, problems = Catalogue(inside if inside.is_dir() else folder).survey()
    return [info for info in reversed(sessions) if info.is_closed], problems


def _chosen(name: str, field: str, filter_name: str) -> tuple[EstimateSet, str | None]:
    from app.estimation.cell_model.cell_file import format_cell
    from app.season.estimates.results import OWN, set_of

    if name == OWN:
        return set_of(name, None, filter_name), None
    model = chosen_cell(name, field)
    text = format_cell(model)
    return set_of(model.name, text, filter_name), text


def _show_progress(progress: EstimateProgress) -> None:
    left = "" if progress.left_s is None else f", {progress.left_s:.0f} s left"
    suffix = f": {progress.error}" if progress.error else ""
    print(f"{progress.done}/{progress.total} {progress.session}{suffix}{left}", file=sys.stderr, flush=True)


def _print_json(
    after: EstimateSet,
    before: EstimateSet | None,
    outcome: Outcome,
    failed: dict[str, str],
    changes: list[EstimateChange],
) -> None:
    shown = {
        "set": {"id": after.id, **asdict(after)},
        "against": None if before is None or before == after else {"id": before.id, **asdict(before)},
        "estimated": outcome.estimated,
        "kept": outcome.kept,
        "failed": failed,
        "took_s": outcome.took_s,
        "processor_s": outcome.processor_s,
        "changes": [asdict(change) for change in changes],
    }
    print(json.dumps(shown, indent=2, allow_nan=False))


def _print_changes(changes: list[EstimateChange]) -> None:
    rows = [
        (
            change.session,
            *(
                scaled(soc, 100, 2)
                for soc in (change.soc_recorded, change.soc_before, change.soc_after, change.soc_rms)
            ),
            *(scaled(factor, 1, 3) for factor in (change.resistance_before, change.resistance_after)),
            *(scaled(ah, 1, 3) for ah in (change.capacity_before_ah, change.capacity_after_ah)),
            *(scaled(volt, 1e3, 2) for volt in (change.innovation_before_v, change.innovation_after_v)),
        )
        for change in changes
    ]
    pairs = [f"{what} {when}" for what in ("resistance", "Ah", "mV") for when in ("before", "after")]
    heads = ("session", "SOC % recorded", "SOC % before", "SOC % after", "apart", *pairs)
    print_table(heads, rows, "<" + ">" * 10)
