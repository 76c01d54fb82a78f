"""`voltwall evidence`: how fast the master opens the shutdown circuit, as a document for the scrutineers."""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from app.analysis.evidence.steps import STEPS, Cycles
from app.commands.arguments import add_data_argument, chosen_cell, data_folder, find_session
from app.commands.console import between, print_table
from app.errors import ConfigError
from app.estimation.cell_model.default_cell import DEFAULT_CELL
from app.words import languages

if TYPE_CHECKING:
    from app.analysis.evidence.evidence import Evidence, StepResult
    from app.commands.evidence_station import Station

EPILOG = """\
Without --serial it injects the faults on a simulated car. With --serial it prompts for each fault at the connector;
each step can be skipped with a reason. Stop the service first if it uses the same port.

examples:
  voltwall evidence
  voltwall evidence --serial /dev/ttyUSB0 --temperature-cycle 0.4
  voltwall evidence --session 20260714-103000          document of a recorded test

exit code 0: all executed steps passed, 1: a step failed or is inconclusive, 2: the test could not run
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments: the master, the steps, the cycles of the firmware, and the document."""
    parser.set_defaults(run=run)
    parser.epilog = EPILOG
    parser.add_argument(
        "--serial", metavar="URL", help="RS232 of a real master, such as /dev/ttyUSB0 (default: simulated)"
    )
    parser.add_argument("--simulated", action="store_true", help="mark the master at --serial as simulated")
    parser.add_argument(
        "--session", metavar="SESSION", help="write the document of a recorded test (ID or file) instead of a new test"
    )
    parser.add_argument(
        "--steps",
        metavar="STEP,...",
        help="run only these steps: " + ", ".join(step.name for step in STEPS) + " (default: all)",
    )
    cycles = Cycles()
    for name, default, text in (
        ("--voltage-cycle", cycles.pass_s, "all voltages and the current"),
        ("--temperature-cycle", cycles.temperature_s, "all temperatures"),
        ("--wire-cycle", cycles.wire_check_s, "the check of all sense wires"),
    ):
        parser.add_argument(
            name,
            type=between(0.001, 10, "s"),
            metavar="S",
            default=default,
            help=f"firmware cycle for {text} (default: %(default)s)",
        )
    parser.add_argument("--cell", default=DEFAULT_CELL, metavar="CELL.toml", help="cell whose data sheet limits apply")
    parser.add_argument("--html", type=Path, metavar="FILE", help="document to write (default: evidence-ID.html)")
    parser.add_argument("--language", choices=languages(), default="en", help="language of the document (default: en)")
    parser.add_argument("--json", action="store_true", help="print results as JSON")
    add_data_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Test, measure, write the document.

    Raises:
        AppError: it could not be tested, or there is no such session.
    """
    from app.analysis.document import document
    from app.analysis.evidence.evidence import evidence_of
    from app.sessions.reading.reader import SessionFile

    if args.session is not None:
        path = find_session(args, args.session)
    elif args.serial is not None:
        path = _person(args)
    else:
        path = _simulated(args)
    with SessionFile(path) as session:
        evidence = evidence_of(session)
    target = args.html or Path(f"evidence-{evidence.session_id}.html")
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(document(evidence, args.language), encoding="utf-8")
    if args.json:
        print(json.dumps(asdict(evidence), indent=2))
    else:
        _print(evidence)
    print(f"session {path}\ndocument {target}", file=sys.stderr)
    return 1 if evidence.outcome == "failed" else 0


def _steps(args: argparse.Namespace) -> set[str]:
    names = {step.name for step in STEPS}
    if args.steps is None:
        return set(names)
    chosen = {name.strip() for name in args.steps.split(",")}
    if unknown := chosen - names:
        raise ConfigError("--steps", sorted(unknown)[0], ", ".join(step.name for step in STEPS))
    return chosen


def _station(args: argparse.Namespace, url: str, *, is_simulated: bool) -> Station:
    from app import __version__
    from app.analysis.evidence.evidence import METADATA
    from app.clock import Clock
    from app.commands.evidence_station import Station
    from app.estimation.cell_model.cell_file import bundled_cells, format_cell

    cell = args.cell if args.cell in bundled_cells() else format_cell(chosen_cell(args.cell))
    station = Station(url, data_folder(args) / "sessions", __version__, Clock())
    cycles = Cycles(args.voltage_cycle, args.temperature_cycle, args.wire_cycle)
    metadata = {"cycles": asdict(cycles), "is_simulated": is_simulated, "url": url, "cell": cell}
    station.start("reaction test", {"source": "simulator" if is_simulated else "serial", METADATA: metadata})
    return station


def _print_line(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _person(args: argparse.Namespace) -> Path:
    from app.commands.evidence_benches import ManualBench
    from app.commands.evidence_station import walk

    names = _steps(args)
    station = _station(args, args.serial, is_simulated=args.simulated)
    return _walked(station, lambda: walk(station, ManualBench(), names, _print_line))


def _simulated(args: argparse.Namespace) -> Path:
    from app.commands.evidence_benches import SCENARIO, SimulatedBench
    from app.commands.evidence_station import walk
    from app.service.settings import Settings
    from app.service.simulator_process import SimulatorProcess

    names = _steps(args)
    with tempfile.TemporaryDirectory(prefix="voltwall-evidence-") as folder:
        scenario = Path(folder) / "reaction-test.toml"
        scenario.write_text(SCENARIO, encoding="utf-8")
        simulator = SimulatorProcess(Settings(data=Path(folder), scenario=str(scenario)))
        try:
            simulator.start()
            station = _station(args, simulator.ports.serial_url, is_simulated=True)
            bench = SimulatedBench(simulator.control.ask)
            return _walked(station, lambda: walk(station, bench, names, _print_line))
        finally:
            simulator.stop()


def _walked(station: Station, go: Callable[[], None]) -> Path:
    status = station.recorder.status.session
    try:
        go()
    finally:
        station.stop()
    if status is None:
        raise RuntimeError("no session was begun")
    return status.path


def _print(evidence: Evidence) -> None:
    car = "SIMULATED master" if evidence.is_simulated else f"master at {evidence.url}"
    print(f"{car}, firmware {evidence.firmware or 'unknown'}, configuration {evidence.config_hash}")
    rows = []
    for step in evidence.steps:
        limit = "-" if step.allowed_s is None else f"{step.allowed_s * 1000:.0f} ms"
        rows.append((step.name, _band(step), limit, f"{step.verdict} {step.why or step.skipped}".rstrip()))
    print_table(("step", "reaction", "limit", "verdict"), rows, "<>><")
    coverage = evidence.coverage
    print(f"measured: {coverage.voltages} voltages and {coverage.temperatures} temperatures of {coverage.cells} cells")
    print(f"outcome: {evidence.outcome}")


def _band(step: StepResult) -> str:
    if step.timing is None:
        return "-"
    return f"{step.timing.low_s * 1000:.0f} to {step.timing.high_s * 1000:.0f} ms"
