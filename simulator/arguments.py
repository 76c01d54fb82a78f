"""What `voltwall simulate` takes; imports nothing of the simulation."""

import argparse
from pathlib import Path

from simulator.inputs import FOR_S, MAX_SPEED, MIN_SPEED, SEED, number_option

DEFAULT_SCENARIO = "race-day"
DESCRIPTION = """\
A simulated accumulator, to be opened like the real thing: the team's own, 96 cells behind a simulated master.

It answers on the ports given here exactly as the car does: RS232 at 115200 8E1 and CAN.
With --battery it is any battery by its profile, which speaks its DBC on CAN.
One line per open port is printed (what to give to `voltwall serve --serial` and `--can`), then `ready`.
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
    parser.add_argument("--serial", metavar="PORT", help="where the RS232 line ends: pty:LINK or tcp:PORT (0: any)")
    parser.add_argument(
        "--can",
        metavar="PORT",
        action="append",
        default=[],
        help="where the bus ends: slcan-pty:LINK or slcan-tcp:PORT (an emulated USB adapter), "
        "log:FILE (a log in candump's format), "
        "or python-can's INTERFACE:CHANNEL[?key=value&...]; may be given again",
    )
    parser.add_argument("--eeprom", metavar="FILE", type=Path, help="keep the EEPROM in this file (default: erased)")
    parser.add_argument(
        "--scenario", metavar="NAME|FILE", default=DEFAULT_SCENARIO, help="what happens (default: %(default)s)"
    )
    parser.add_argument(
        "--seed",
        type=number_option(SEED),
        metavar="N",
        help="another draw of cells, sensors and drivers, 0 to 4294967295 (default: the scenario's)",
    )
    parser.add_argument("--speed", type=_speed, default=1.0, metavar="N|max", help="times real time (default: 1)")
    parser.add_argument(
        "--duration", type=number_option(FOR_S), metavar="S", help="end after so many simulated seconds"
    )
    parser.add_argument(
        "--control", metavar="PORT|PATH", help="take faults while running: a port on 127.0.0.1, or a Unix socket"
    )
    parser.add_argument("--with-parent", action="store_true", help="end when standard input does")
    parser.add_argument("--list", action="store_true", help="list the scenarios and end")
    parser.add_argument(
        "--json", action="store_true", help="with --list: as JSON, with the seconds that a round takes at the most"
    )
    parser.add_argument("--describe", metavar="NAME", help="describe a scenario and end")


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
