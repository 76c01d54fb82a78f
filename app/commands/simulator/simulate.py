"""`voltwall simulate`: hands over to the simulator; with `--battery`, what it shall be and how it speaks."""

import argparse
import math
import sys

from app.battery.source import SpeaksDbc
from app.errors import ConfigError
from app.estimation.cell_model.cell_file import load_cell
from app.estimation.errors import CellFileError
from app.sources.dbc.encoding.speech import Speech
from app.sources.loaded_battery import LoadedBattery, load_battery
from app.words import render
from simulator.cli import run as run_simulator
from simulator.dbc_battery.battery import DbcBattery
from simulator.shape import Shape


def run(args: argparse.Namespace) -> int:
    """Run it in this process."""
    if args.battery is None:
        return run_simulator(args)
    loaded = load_battery(args.battery)
    source = loaded.speaks_dbc
    return run_simulator(args, None if source is None else simulated(loaded, source))


def simulated(loaded: LoadedBattery, source: SpeaksDbc) -> DbcBattery:
    """Return what the simulator makes of a battery; what its DBC has no place for is told on standard error.

    Raises:
        ConfigError: its cell file is wrong, or no signal of its DBC fits the profile.
    """
    battery = loaded.battery
    profile = next(iter(loaded.files))
    try:
        cell = load_cell(battery.cell)
    except CellFileError as error:
        raise ConfigError("battery.cell", battery.cell, str(error)) from error
    speech = Speech(battery, source, loaded.definitions)
    for trouble in speech.lanes.troubles:
        place = profile if trouble.line is None else f"{profile}:{trouble.line}"
        print(f"voltwall simulate: {place}: {trouble.field}: {render(trouble.what)}", file=sys.stderr)
    for kind, channels in speech.unsaid().items():
        print(f"voltwall simulate: {len(channels)} values of {kind} have no place in the DBC", file=sys.stderr)
    if math.isinf(speech.due_s):
        raise ConfigError("source", profile, "no signal of the DBC fits the profile: nothing would be sent")
    limits = {name: limit for name, limit in battery.limits.items() if isinstance(limit, float)}
    return DbcBattery(Shape(battery.segments), battery.sensors, cell.capacity_ah, limits, speech)
