"""`voltwall evidence`: how fast the master opens the shutdown circuit, as a document for the scrutineers."""

import argparse
import json
import sys
import tempfile
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

from app import __version__
from app.analysis.document import document
from app.analysis.evidence.evidence import METADATA, Evidence, StepResult, evidence_of
from app.analysis.evidence.steps import STEPS, Cycles
from app.clock import Clock
from app.commands.console.terminal import print_table
from app.commands.guided.benches import SCENARIO, PersonAtThePlug, SimulatedBench
from app.commands.guided.station import Station
from app.commands.guided.walk import walk
from app.commands.session_commands.selection import data_folder, find_session
from app.errors import ConfigError
from app.estimation.cell_model.cell_file import bundled_cells, format_cell, load_cell
from app.estimation.errors import EstimatorError
from app.service.settings import Settings
from app.service.simulator_process import SimulatorProcess
from app.sessions.reading.reader import SessionFile


def run(args: argparse.Namespace) -> int:
    """Test, measure, write the document.

    Raises:
        AppError: it could not be tested, or there is no such session.
    """
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
        json.dump(asdict(evidence), sys.stdout, indent=2)
        print()
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
    try:
        cell = args.cell if args.cell in bundled_cells() else format_cell(load_cell(args.cell))
    except EstimatorError as error:
        raise ConfigError("cell", args.cell, str(error)) from error
    station = Station(url, data_folder(args) / "sessions", __version__, Clock())
    cycles = Cycles(args.voltage_cycle, args.temperature_cycle, args.wire_cycle)
    metadata = {"cycles": asdict(cycles), "is_simulated": is_simulated, "url": url, "cell": cell}
    station.start("reaction test", {"source": "simulator" if is_simulated else "serial", METADATA: metadata})
    return station


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _person(args: argparse.Namespace) -> Path:
    names = _steps(args)
    station = _station(args, args.serial, is_simulated=args.simulated)
    return _walked(station, lambda: walk(station, PersonAtThePlug(), names, _say))


def _simulated(args: argparse.Namespace) -> Path:
    names = _steps(args)
    with tempfile.TemporaryDirectory(prefix="voltwall-evidence-") as folder:
        scenario = Path(folder) / "reaction-test.toml"
        scenario.write_text(SCENARIO, encoding="utf-8")
        simulator = SimulatorProcess(Settings(data=Path(folder), scenario=str(scenario)))
        try:
            simulator.start()
            station = _station(args, simulator.ports.serial_url, is_simulated=True)
            bench = SimulatedBench(simulator.control.ask)
            return _walked(station, lambda: walk(station, bench, names, _say))
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
