"""`voltwall simulate`: hands over to the simulator; with `--battery`, what it shall be and how it speaks."""

import argparse
import math
import sys

from app.battery.library import LoadedProfile, load_profile
from app.battery.source import SpeaksDbc, SpeaksMaster
from app.commands.battery_commands.inputs import definitions_of
from app.errors import ConfigError
from app.estimation.cell_model.cell_file import load_cell
from app.estimation.errors import CellFileError
from app.sources.dbc.encoding.speech import Speech
from app.words import render
from simulator.cli import add_arguments as add_simulator_arguments
from simulator.cli import run as run_simulator
from simulator.dbc_battery.battery import DbcBattery
from simulator.shape import Shape


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The simulator's own, and the battery."""
    add_simulator_arguments(parser)
    parser.add_argument(
        "--battery", metavar="NAME|FILE", help="a battery by its profile, on CAN by its DBC (default: the team's own)"
    )


def run(args: argparse.Namespace) -> int:
    """Run it in this process."""
    if args.battery is None:
        return run_simulator(args)
    loaded = load_profile(args.battery)
    return run_simulator(args, None if isinstance(loaded.profile.source, SpeaksMaster) else simulated(loaded))


def simulated(loaded: LoadedProfile) -> DbcBattery:
    """Return what the simulator makes of a profile; what its DBC has no place for is told on standard error.

    Raises:
        ConfigError: its cell file is wrong, or no signal of its DBC fits the profile.
        ImportFailed: the DBC cannot be read.
    """
    battery, source = loaded.profile.battery, loaded.profile.source
    if not isinstance(source, SpeaksDbc):
        raise ConfigError("battery", battery.name, "speaks by no DBC")
    try:
        cell = load_cell(battery.cell)
    except CellFileError as error:
        raise ConfigError("battery.cell", battery.cell, str(error)) from error
    speech = Speech(battery, source, definitions_of(loaded.dbc_files))
    for trouble in speech.lanes.troubles:
        place = loaded.profile.file if trouble.line is None else f"{loaded.profile.file}:{trouble.line}"
        print(f"voltwall simulate: {place}: {trouble.field}: {render(trouble.what)}", file=sys.stderr)
    for kind, channels in speech.unsaid().items():
        print(f"voltwall simulate: {len(channels)} values of {kind} have no place in the DBC", file=sys.stderr)
    if math.isinf(speech.due_s):
        raise ConfigError("source", loaded.profile.file, "no signal of the DBC fits the profile: nothing would be sent")
    limits = {name: limit for name, limit in battery.limits.items() if isinstance(limit, float)}
    return DbcBattery(Shape(battery.segments), battery.sensors, cell.capacity_ah, limits, speech)
