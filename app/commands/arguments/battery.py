"""`voltwall battery`: profiles of batteries that are not the team's own."""

import argparse
from pathlib import Path

from app.commands.arguments.work import Work
from app.commands.console.number import percent, segments
from app.estimation.cell_model.default_cell import DEFAULT_CELL

_MOST_PARALLEL = 1000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the actions."""
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    for add in (_add_show, _add_check, _add_learn, _add_size):
        add(actions)


def _add_show(actions: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the actions."""
    listing = actions.add_parser("list", help="the profiles that come with the program")
    listing.add_argument("--json", action="store_true", help="as JSON")
    listing.set_defaults(do=Work("battery.show.list_profiles"))
    showing = actions.add_parser("show", help="what a profile means, with a drawing")
    showing.add_argument("profile", metavar="NAME|FILE", help="a bundled profile, or a TOML file")
    showing.add_argument("--toml", action="store_true", help="the profile's text, to copy and change")
    showing.set_defaults(do=Work("battery.show.show_profile"))


def _add_check(actions: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the action."""
    checking = actions.add_parser(
        "check",
        help="every doubt of a profile and its DBC, by line and field; exit code 1 where there is one,\n"
        "2 where the profile cannot work",
        formatter_class=argparse.RawTextHelpFormatter,
    )
    checking.add_argument("--json", action="store_true", help="as JSON")
    checking.add_argument("profile", metavar="NAME|FILE", help="a bundled profile, or a TOML file")
    checking.add_argument(
        "--log", type=Path, metavar="FILE", help="a CAN log of this battery: .log (candump), .trc, .asc, .blf, .mf4"
    )
    checking.set_defaults(do=Work("battery.check.check"))


def _add_learn(actions: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the action."""
    learning = actions.add_parser(
        "learn",
        help="what speaks on a bus or in a log, and a profile with the reasons for it; exit code 1 where none fits",
    )
    learning.add_argument(
        "--dbc", type=Path, action="append", default=[], metavar="FILE",
        help="message definitions: .dbc, .sym, .kcd, .arxml; may be given again (default: those that come along)",
    )  # fmt: skip
    source = learning.add_mutually_exclusive_group()
    source.add_argument("--log", type=Path, metavar="FILE", help="a CAN log: .log (candump), .trc, .asc, .blf, .mf4")
    source.add_argument("--can", metavar="IF:CH", help="listen to a bus: a python-can interface and channel")
    learning.add_argument("--seconds", type=float, default=30.0, metavar="S", help="how long to listen (default: 30)")
    learning.add_argument("--name", default="", help="what people call the battery (default: the DBC's name)")
    learning.add_argument("--out", type=Path, metavar="FILE", help="write the profile (default: standard output)")
    learning.add_argument("--signals", action="store_true", help="list every signal with its range too")
    learning.add_argument(
        "--with-states", action="store_true",
        help="take the states as proposed (default: in comments, for a person to confirm)",
    )  # fmt: skip
    learning.set_defaults(do=Work("battery.learn.learn_profile"))


def _add_size(actions: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare the action."""
    sizing = actions.add_parser(
        "size",
        help="voltage, capacity, energy, mass, currents, power and resistance of a battery of given cells",
    )
    sizing.add_argument(
        "--cell", default=DEFAULT_CELL, metavar="CELL.toml",
        help="cell file (TOML) or the name of a bundled one (default: %(default)s)",
    )  # fmt: skip
    sizing.add_argument(
        "--segments", type=segments, required=True, metavar="8x12",
        help="segments in series x cells in series in each",
    )  # fmt: skip
    sizing.add_argument(
        "--parallel", type=_parallel, default=1, metavar="N",
        help="how many of what the cell file describes are in parallel (default: 1)",
    )  # fmt: skip
    sizing.add_argument(
        "--soc", type=percent, default=50.0, metavar="PERCENT",
        help="state of charge for which power and resistance hold (default: 50)",
    )  # fmt: skip
    sizing.add_argument(
        "--temperature", type=float, default=25.0, metavar="DEGC",
        help="temperature of the cells for which they hold (default: 25)",
    )  # fmt: skip
    sizing.add_argument("--json", action="store_true", help="print the figures as JSON")
    sizing.set_defaults(do=Work("battery.size.size"))


def _parallel(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= _MOST_PARALLEL:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of 1 to {_MOST_PARALLEL}")
    return int(text)
