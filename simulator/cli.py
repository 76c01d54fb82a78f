"""`voltwall simulate`: the simulated accumulator as a process of its own."""

import argparse
import json
import os
import signal
import sys
import threading
from collections.abc import Sequence

from simulator.arguments import add_arguments
from simulator.can_ports import can_port
from simulator.control import Control
from simulator.control_server import ControlServer
from simulator.dbc_battery.battery import DbcBattery
from simulator.eeprom import Eeprom
from simulator.errors import InputError, SimulatorError
from simulator.library import find_scenario, library
from simulator.ports import byte_port
from simulator.runner import Runner
from simulator.scenario import Scenario
from simulator.scenario_player import Notice, ScenarioPlayer
from simulator.shape import TEAM

EXIT_OK, EXIT_FAILED = 0, 2


def run(arguments: argparse.Namespace, battery: DbcBattery | None = None) -> int:
    """Carry out `simulate` and return the exit code; without a battery it is the team's own."""
    shape = TEAM if battery is None else battery.shape
    try:
        if arguments.json and not arguments.list:
            raise InputError("json", "--json goes with --list")
        if arguments.list:
            scenarios, unreadable = library(shape=shape)
            if arguments.json:
                print(json.dumps([_listed(each) for each in scenarios], indent=2))
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
    if battery is not None and (arguments.serial or arguments.eeprom):
        raise InputError("serial", "--serial and --eeprom are of the team's own master; this battery speaks CAN only")
    seed = None if arguments.seed is None else int(arguments.seed)
    player = ScenarioPlayer(scenario, eeprom=Eeprom(arguments.eeprom), seed=seed, battery=battery)
    player.on_notice = _print_notice
    serial = None if arguments.serial is None else byte_port(arguments.serial)
    can = [can_port(text) for text in arguments.can]
    if battery is not None and battery.voice.has_fd_frames:
        for port in can:
            port.carry_fd()
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


def _print_notice(notice: Notice) -> None:
    print(f"voltwall simulate: {notice}", file=sys.stderr, flush=True)


def _stop_with_parent(runner: Runner) -> None:
    while os.read(sys.stdin.fileno(), 4096):
        pass
    runner.stop()


if __name__ == "__main__":
    sys.exit(main())
