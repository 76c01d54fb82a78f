"""`voltwall simulate`: the simulated accumulator as a process of its own; imports the simulation when it runs."""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from simulator.errors import InputError, SimulatorError
from simulator.inputs import FOR_S, MAX_SPEED, MIN_SPEED, SEED, number_option

if TYPE_CHECKING:
    from simulator.can_ports import CanPort
    from simulator.dbc_battery.battery import DbcBattery
    from simulator.runner import Runner
    from simulator.scenario import Scenario
    from simulator.scenario_player import Notice

EXIT_OK, EXIT_FAILED = 0, 2
DEFAULT_SCENARIO = "race-day"
DESCRIPTION = """\
Run a simulated accumulator on ports like the real one: by default the built-in example car with 96 cells and a master.


The ports behave like the car: RS232 at 115200 8E1 and CAN. With --battery any battery profile is simulated, on CAN or
a serial line.
One line per open port is printed (the value for `voltwall serve --serial` or `--can`), then `ready`.
"""
EPILOG = """\
examples:
  voltwall simulate --serial pty:/tmp/master --can slcan-pty:/tmp/can
  voltwall simulate --serial tcp:4001 --can slcan-tcp:4002 --scenario loose-bolt --speed 10
  voltwall simulate --serial pty:/tmp/master --can socketcan:vcan0 --eeprom eeprom.bin
  voltwall simulate --battery foxbms-2 --can slcan-tcp:4002
  voltwall simulate --battery mine.toml --can log:mine.log --speed max --duration 60
  voltwall simulate --list
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `simulate`."""
    parser.description = DESCRIPTION
    parser.epilog = EPILOG
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument(
        "--serial", metavar="PORT", help="RS232 port to create: pty:LINK or tcp:PORT (0: any free port)"
    )
    parser.add_argument(
        "--can",
        metavar="PORT",
        action="append",
        default=[],
        help="CAN port to create: slcan-pty:LINK or slcan-tcp:PORT (an emulated USB adapter), "
        "log:FILE (a log in candump's format), "
        "or python-can's INTERFACE:CHANNEL[?key=value&...]; repeatable",
    )
    parser.add_argument("--eeprom", metavar="FILE", type=Path, help="EEPROM file (default: erased at start)")
    parser.add_argument(
        "--scenario", metavar="NAME|FILE", default=DEFAULT_SCENARIO, help="scenario (default: %(default)s)"
    )
    parser.add_argument(
        "--seed",
        type=number_option(SEED),
        metavar="N",
        help="random seed of cells, sensors and drivers, 0 to 4294967295 (default: that of the scenario)",
    )
    parser.add_argument(
        "--speed", type=_speed, default=1.0, metavar="N|max", help="speed relative to real time (default: 1)"
    )
    parser.add_argument(
        "--duration", type=number_option(FOR_S), metavar="S", help="simulated seconds to run (default: until Ctrl+C)"
    )
    parser.add_argument(
        "--control", metavar="PORT|PATH", help="accept fault injection on a port of 127.0.0.1 or a Unix socket"
    )
    parser.add_argument("--with-parent", action="store_true", help="exit when standard input closes")
    parser.add_argument("--list", action="store_true", help="list the scenarios")
    parser.add_argument(
        "--json", action="store_true", help="with --list: print JSON, including the maximum duration of a run"
    )
    parser.add_argument("--describe", metavar="NAME", help="describe a scenario")


def _speed(text: str) -> float | None:
    if text == "max":
        return None
    try:
        speed = float(text)
    except ValueError:
        speed = 0.0
    if not MIN_SPEED <= speed <= MAX_SPEED:
        raise argparse.ArgumentTypeError(f"{text!r} is neither {MIN_SPEED:g}..{MAX_SPEED:g} nor `max`")
    return speed


def run(arguments: argparse.Namespace, battery: DbcBattery | None = None) -> int:
    """Carry out `simulate` and return the exit code; without a battery it is the team's own."""
    from simulator.library import find_scenario, library
    from simulator.shape import TEAM

    shape = TEAM if battery is None else battery.shape
    try:
        if arguments.json and not arguments.list:
            raise InputError("json", "--json goes with --list")
        if arguments.list:
            scenarios, unreadable = library(shape=shape)
            if arguments.json:
                print(json.dumps([_listed(scenario) for scenario in scenarios], indent=2))
            else:
                for scenario in scenarios:
                    print(f"{scenario.name:24} {scenario.title}")
            for file in unreadable:
                print(f"voltwall simulate: left out: {file.reason}", file=sys.stderr)
            return EXIT_OK
        if arguments.describe is not None:
            print(find_scenario(arguments.describe, shape).describe())
            return EXIT_OK
        _simulate(arguments, find_scenario(arguments.scenario, shape), battery)
    except SimulatorError as error:
        print(f"voltwall simulate: {error}", file=sys.stderr)
        return EXIT_FAILED
    return EXIT_OK


def main(argv: Sequence[str] | None = None) -> int:
    """Run `simulate` by itself."""
    parser = argparse.ArgumentParser(prog="voltwall simulate")
    add_arguments(parser)
    return run(parser.parse_args(argv))


def _listed(scenario: Scenario) -> dict[str, str | float | bool | None]:
    return {
        "name": scenario.name,
        "title": scenario.title,
        "seconds": scenario.longest_s,
        "loop": scenario.loop,
    }


def _simulate(arguments: argparse.Namespace, scenario: Scenario, battery: DbcBattery | None) -> None:
    from simulator.can_ports import can_port
    from simulator.control import Control
    from simulator.control_server import ControlServer
    from simulator.eeprom import Eeprom
    from simulator.ports import byte_port
    from simulator.runner import Runner
    from simulator.scenario_player import ScenarioPlayer

    if battery is not None and (arguments.eeprom or (arguments.serial and battery.serial is None)):
        raise InputError("serial", "--serial and --eeprom are for the team's master; this battery has CAN only")
    seed = None if arguments.seed is None else int(arguments.seed)
    player = ScenarioPlayer(scenario, eeprom=Eeprom(arguments.eeprom), seed=seed, battery=battery)
    player.on_notice = _print_notice
    serial = None if arguments.serial is None else byte_port(arguments.serial)
    can = [can_port(text) for text in arguments.can]
    if battery is not None:
        _fit(can, battery)
    runner = Runner(player.simulation, serial=serial, can=can, speed=arguments.speed)
    control = None if arguments.control is None else ControlServer(arguments.control, Control(player, runner))
    runner.open()
    try:
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            signum = getattr(signal, name, None)  # Windows knows no SIGHUP
            if signum is not None and signal.getsignal(signum) is not signal.SIG_IGN:  # as nohup asks
                signal.signal(signum, lambda *_: runner.stop())
        if serial is not None:
            print(f"serial: {serial.url}", flush=True)
        for port in can:
            print(f"can: {port.url}", flush=True)
        if control is not None:
            control.open(runner.selector)
            print(f"control: {control.url}", flush=True)
        if serial is None and not can and control is None:
            print("voltwall simulate: nothing can reach it: give --serial, --can or --control", file=sys.stderr)
        print("ready", flush=True)
        if arguments.with_parent:
            threading.Thread(target=_stop_with_parent, args=(runner,), daemon=True).start()
        runner.run(arguments.duration, lambda: player.is_over)
    finally:
        if control is not None:
            control.close()
        runner.close()


def _fit(ports: list[CanPort], battery: DbcBattery) -> None:
    from simulator.can_ports import LogPort

    for port in ports:
        if isinstance(port, LogPort):
            port.bit_rate = battery.bit_rate
        if battery.voice.has_fd_frames:
            port.carry_fd()


def _print_notice(notice: Notice) -> None:
    print(f"voltwall simulate: {notice}", file=sys.stderr, flush=True)


def _stop_with_parent(runner: Runner) -> None:
    while os.read(sys.stdin.fileno(), 4096):
        pass
    runner.stop()


if __name__ == "__main__":
    sys.exit(main())
