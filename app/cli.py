"""The program `voltwall`: finds the command, a file of `app/commands` by its name, and runs it."""

import argparse
import importlib
import os
import re
import sys
from collections.abc import Sequence
from io import TextIOWrapper
from typing import NoReturn

from app import __version__
from app.commands.console import RED, coloured, printable
from app.errors import AppError
from app.estimation.errors import EstimatorError
from firmware_protocol.names import did_you_mean

REFUSED = 2
INTERRUPTED = 130  # as shells count a process that SIGINT ended
_INVALID_CHOICE = re.compile(r"invalid choice: '(.*?)' \(choose from (.*)\)")
_UNRECOGNIZED = re.compile(r"unrecognized arguments: ((\S+).*)")
COMMANDS = {
    "serve": "start the service: connect to the battery, estimate, record, serve the pages",
    "simulate": "run the simulated accumulator alone, on a serial or CAN port like the real one",
    "replay": "replay a recorded session, in the pages or against expectations",
    "sessions": "list, check, download, import and delete sessions; laps, reports, black boxes",
    "accounts": "manage users and API tokens; show the signed log",
    "evidence": "measure how fast the master opens the shutdown circuit (EV 5.8), as a document for the scrutineers",
    "battery": "battery profiles: list, show, check, create one from a DBC, size a pack",
    "season": "analyse many sessions: season data, SQL queries, trends, module swaps, re-estimation",
    "export": "export a session as CSV, Parquet, MDF 4, MCAP, MoTeC or CAN log",
    "config": "read, write, store and roll back the master's configuration through a running service",
    "dbc": "write the master's CAN tables as a DBC file",
    "firmware": "write a cell model as a C header for the estimator on the master",
    "identify": "fit a cell model to test data",
    "estimate": "estimate the SOC of a recorded cell test",
    "balance": "simulate a charge or a rest with each balancing circuit: time, heat, remaining spread",
    "completion": "print the Tab completion for bash, zsh, fish or PowerShell",
    "bench": "measure this machine: filter, decoder, latency, memory",
}

EXAMPLES = {
    "serve": ("serve", "serve --serial /dev/ttyUSB0 --can socketcan:can0", "serve --host 0.0.0.0 --tls"),
    "replay": ("replay SESSION", "replay SESSION --speed 10", "replay SESSION --assert expected.toml"),
    "sessions": ("sessions list", "sessions import log.csv", "sessions report SESSION --html report"),
    "accounts": ("accounts add anna --role engineer", "accounts token logger --days 7", "accounts list"),
    "battery": ("battery list", "battery learn --dbc bms.dbc --can socketcan:can0 --out bms.toml"),
    "season": ("season build", "season report --html season", "season swap 3/7,3/8 --note spare"),
    "export": ("export SESSION --out run.csv", "export SESSION --format motec --out run.zip"),
    "config": ("config read", "config write telemetry_period=50 --store", "config history"),
    "dbc": ("dbc --out master.dbc",),
    "firmware": ("firmware --cell samsung-25r-10p --out vw_cell_of_team.h",),
    "identify": ("identify --ocv slow.csv --pulses hppc.csv --drive race.csv --out cell.toml",),
    "estimate": ("estimate race.csv --cell cell.toml --plot race.png",),
    "completion": ("completion bash",),
    "bench": ("bench --seconds 10",),
}  # the other commands have theirs next to their options


class Parser(argparse.ArgumentParser):
    """A parser, and those below it, that names the command or flag that was probably meant."""

    def error(self, message: str) -> NoReturn:
        """Print the usage and what is wrong, and exit with 2."""
        if wrong := _INVALID_CHOICE.search(message):
            choices = [choice.strip("' ") for choice in wrong[2].split(",")]
            message = message.replace(": invalid choice: ", ": unknown ", 1)
            meant = did_you_mean(wrong[1], choices) or "."
            message = message.replace(f" (choose from {wrong[2]})", meant, 1)
            message += f" Use one of {', '.join(choices)}."
        elif flags := _UNRECOGNIZED.search(message):
            message = f"unknown {flags[1]}{did_you_mean(flags[2].partition('=')[0], self._flags())}"
        super().error(message)

    def _flags(self) -> list[str]:
        """Every flag of this parser and of those below it."""
        flags: list[str] = []
        for action in self._actions:
            flags += action.option_strings
            if isinstance(action, argparse._SubParsersAction):
                for below in action.choices.values():
                    flags += below._flags()
        return flags


def build_parser(only: str | None = None) -> argparse.ArgumentParser:
    """Return the whole parser; with `only`, one that knows just that command's options (others are not imported)."""
    parser = Parser(prog="voltwall", description="The pit wall for a Formula Student battery.")
    parser.add_argument("--version", action="version", version=f"voltwall {__version__}")
    parser.add_argument("--no-color", action="store_true", help="no colours (same as NO_COLOR=1)")
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name, text in COMMANDS.items():
        command = subparsers.add_parser(
            name, help=text, description=text[0].upper() + text[1:] + ".", formatter_class=argparse.RawTextHelpFormatter
        )
        if only is None or name == only:
            importlib.import_module(f"{__package__}.commands.{name}").add_arguments(command)
            if name in EXAMPLES:
                lines = "\n".join(f"  voltwall {example}" for example in EXAMPLES[name])
                command.epilog = "\n\n".join(filter(None, (command.epilog, f"examples:\n{lines}")))
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command; errors that a user can fix are one line on stderr and exit code 2, Ctrl-C one line and 130."""
    if sys.maxsize < 1 << 32:  # libraries that it needs have no such build, and the engine is tested on none
        print("voltwall: needs a 64-bit system with a 64-bit Python, and this one is of 32 bits", file=sys.stderr)
        return 2
    arguments = list(sys.argv[1:] if argv is None else argv)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # `Łukasz` on a terminal of code page 1252 is no reason to fail
            stream.reconfigure(errors="replace")
    only = next((word for word in arguments if word in COMMANDS), "")
    if "--no-color" in arguments:  # before or behind the command
        arguments.remove("--no-color")
        os.environ["NO_COLOR"] = "1"  # what argparse goes by, too, from Python 3.14 on
    try:
        if "_ARGCOMPLETE" in os.environ:  # the shell asks, with the line so far
            _complete()
        args = build_parser(only).parse_args(arguments)
        return int(args.run(args))
    except (AppError, EstimatorError) as error:
        return _refuse(only, str(error), getattr(error, "exit_code", REFUSED))
    except KeyboardInterrupt:
        print(f"voltwall {only}: interrupted".replace(" :", ":"), file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        return 0
    except OSError as error:  # a file that was named; a command that knows more reports it
        place = "" if error.filename is None else f"{error.filename}: "
        return _refuse(only, f"{place}{error.strerror or error}", REFUSED)


def _refuse(command: str, reason: str, exit_code: int) -> int:
    print(coloured(f"voltwall {command}:", RED, sys.stderr), printable(reason), file=sys.stderr)
    return exit_code


def _complete() -> None:
    """Answer the shell and end, where argcomplete is installed."""
    line = os.environ.get("COMP_LINE", "").split()
    parser = build_parser(next((word for word in line[1:] if word in COMMANDS), ""))
    importlib.import_module("argcomplete").autocomplete(parser)


if __name__ == "__main__":
    sys.exit(main())
