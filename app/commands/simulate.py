"""`voltwall simulate`: the simulated accumulator, or with `--battery` any other."""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import replace
from typing import TYPE_CHECKING

from app.commands.arguments import chosen_cell
from app.errors import ConfigError
from app.words import Message, render
from simulator.cli import add_arguments as add_simulator_arguments
from simulator.cli import run as run_simulator

if TYPE_CHECKING:
    from app.battery.serial import SerialMapping
    from app.battery.source import DbcMapping
    from app.sources.loaded_battery import LoadedBattery
    from simulator.dbc_battery.battery import DbcBattery

BIT_RATES = (125_000, 250_000, 500_000, 1_000_000)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The simulator's own, and the battery."""
    parser.set_defaults(run=run)
    add_simulator_arguments(parser)
    parser.add_argument(
        "--battery",
        metavar="NAME|FILE",
        help="battery profile, or packs x series cells such as 2x6, on CAN or serial (default: the built-in car)",
    )

    parser.add_argument(
        "--bit-rate",
        type=int,
        choices=BIT_RATES,
        metavar="BIT/S",
        help=f"bit rate of the battery's CAN bus, with --battery: {', '.join(map(str, BIT_RATES))} (default: 500000)",
    )
    parser.add_argument(
        "--alone", action="store_true", help="with --battery: no other node on the bus acknowledges frames"
    )


def run(args: argparse.Namespace) -> int:
    """Run it in this process."""
    if args.battery is None:
        if args.bit_rate is not None:
            raise ConfigError("bit_rate", args.bit_rate, Message("bit-rate-of-battery"))
        return run_simulator(args)
    from app.sources.loaded_battery import load_battery

    loaded = load_battery(args.battery)
    source, serial = loaded.dbc_mapping, loaded.serial
    if serial is not None:
        return run_simulator(args, simulated_serial(loaded, serial))
    if source is None:
        return run_simulator(args)
    battery = simulated(loaded, source)
    return run_simulator(args, replace(battery, bit_rate=args.bit_rate or battery.bit_rate, is_alone=args.alone))


def simulated_serial(loaded: LoadedBattery, mapping: SerialMapping) -> DbcBattery:
    """Return what the simulator makes of a battery on a serial line.

    Raises:
        ConfigError: its cell file is wrong.
    """
    from app.sources.serial.encoder import SerialEncoder
    from simulator.dbc_battery.battery import DbcBattery, SilentBus
    from simulator.shape import Shape

    battery = loaded.battery
    cell = chosen_cell(battery.cell, "battery.cell")
    limits = {name: limit for name, limit in battery.limits.items() if isinstance(limit, float)}
    encoder = SerialEncoder(battery, mapping)
    return DbcBattery(Shape(battery.segments), battery.sensors, cell.capacity_ah, limits, SilentBus(), encoder)


def simulated(loaded: LoadedBattery, source: DbcMapping) -> DbcBattery:
    """Return what the simulator makes of a battery; what its DBC has no place for goes to standard error.

    Raises:
        ConfigError: its cell file is wrong, or no signal of its DBC fits the profile.
    """
    from app.sources.dbc.encoder import FrameEncoder
    from simulator.dbc_battery.battery import DbcBattery
    from simulator.shape import Shape

    battery = loaded.battery
    profile = next(iter(loaded.files))
    cell = chosen_cell(battery.cell, "battery.cell")
    speech = FrameEncoder(battery, source, loaded.definitions)
    for trouble in speech.lanes.troubles:
        place = profile if trouble.line is None else f"{profile}:{trouble.line}"
        print(f"voltwall simulate: {place}: {trouble.field}: {render(trouble.what)}", file=sys.stderr)
    for kind, channels in speech.not_encoded().items():
        print(f"voltwall simulate: {len(channels)} values of {kind} have no place in the DBC", file=sys.stderr)
    if math.isinf(speech.due_s):
        raise ConfigError("source", profile, "no signal of the DBC fits the profile: nothing would be sent")
    limits = {name: limit for name, limit in battery.limits.items() if isinstance(limit, float)}
    return DbcBattery(Shape(battery.segments), battery.sensors, cell.capacity_ah, limits, speech)
