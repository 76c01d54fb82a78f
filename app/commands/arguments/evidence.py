"""`voltwall evidence`: how fast the master opens the shutdown circuit, as a document for the scrutineers."""

import argparse
from pathlib import Path

from app.analysis.evidence.steps import STEPS, Cycles
from app.commands.arguments.common import add_data_argument
from app.commands.arguments.work import Work
from app.commands.console.number import between
from app.estimation.cell_model.default_cell import DEFAULT_CELL
from app.words import languages

EPILOG = """\
Without --serial it walks through the faults on a simulated car. With --serial it asks a person at the plug,
step by step; each step can be skipped with a reason. The service must not hold the same port.

examples:
  voltwall evidence
  voltwall evidence --serial /dev/ttyUSB0 --temperature-cycle 0.4
  voltwall evidence --session 20260714-103000          the document again, of a recorded test

exit code 0: every step that was done is in time, 1: a limit failed or is not shown, 2: it could not be tested
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which master, which steps, what the firmware's cycles are, where the document goes."""
    parser.set_defaults(do=Work("evidence.run"))
    parser.epilog = EPILOG
    parser.add_argument("--serial", metavar="URL", help="RS232 of a real master, as /dev/ttyUSB0 (default: simulated)")
    parser.add_argument("--simulated", action="store_true", help="the master behind --serial is a simulated one")
    parser.add_argument("--session", metavar="SESSION", help="no new test: the document of a recorded one, id or file")
    parser.add_argument(
        "--steps",
        metavar="STEP,...",
        help="only these steps: " + ", ".join(step.name for step in STEPS) + " (default: all)",
    )
    cycles = Cycles()
    for name, default, text in (
        ("--voltage-cycle", cycles.pass_s, "all voltages and the current"),
        ("--temperature-cycle", cycles.temperature_s, "every temperature"),
        ("--wire-cycle", cycles.wire_check_s, "the check of every wire"),
    ):
        parser.add_argument(
            name,
            type=between(0.001, 10, "s"),
            metavar="S",
            default=default,
            help=f"how often the firmware measures {text} (default: %(default)s)",
        )
    parser.add_argument("--cell", default=DEFAULT_CELL, metavar="CELL.toml", help="whose data sheet counts")
    parser.add_argument("--html", type=Path, metavar="FILE", help="where the document goes (default: evidence-ID.html)")
    parser.add_argument("--language", choices=languages(), default="en", help="of the document (default: en)")
    parser.add_argument("--json", action="store_true", help="print what was found as JSON")
    add_data_argument(parser)
