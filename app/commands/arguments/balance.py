"""`voltwall balance`: what each balancing circuit makes of a charge or a rest, simulated."""

import argparse
from pathlib import Path

from app.commands.arguments.work import Work
from app.commands.console.number import between, segments
from simulator.balancing.choices import CIRCUITS, LIMITS

DESCRIPTION = """\
Simulate a charge or a rest with each balancing circuit: how long it takes, how warm it gets, what is left of the
difference, and what was lost. Bleed resistors follow the measured voltages while it charges; at rest, and with
transformers, the cell to drive is chosen by its true SOC, which no master knows as well.
"""
EPILOG = """\
examples:
  voltwall balance                                  the car's 8 packs of 12, charged at 0.5C from 20 %
  voltwall balance --rest --soc 90 --hours 12       at rest
  voltwall balance --thesis --rate 1 --resistor 40  six cells of the balancing thesis, its own figures beside
  voltwall balance --segments 1x14 --circuit transformer --spread 5 --picture balance.svg
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.set_defaults(do=Work("simulator.balance.run"))
    parser.description, parser.epilog = DESCRIPTION, EPILOG
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument(
        "--circuit", action="append", choices=CIRCUITS, help="may be repeated (default: all, and none beside them)"
    )
    parser.add_argument("--thesis", action="store_true", help="the six cells of the balancing thesis, not the car's")
    parser.add_argument(
        "--segments", type=segments, metavar="8x12",
        help="packs in series x cells in series in each (default: 8x12; with --thesis 1x6)",
    )  # fmt: skip
    kind = parser.add_mutually_exclusive_group()
    kind.add_argument(
        "--rate", type=between(*LIMITS["rate_c"], "C"), metavar="C",
        help="charge at this current over the rated capacity (default: 0.5)",
    )  # fmt: skip
    kind.add_argument("--rest", action="store_true", help="no charge: balance at rest until --until or --hours")
    parser.add_argument("--hours", type=between(*LIMITS["hours"], "h"), help="the longest it may take (default: 24)")
    percent = {"soc": "mean state of charge at the start", "spread": "highest less lowest at the start"}
    for name, meaning in percent.items():
        low, high = LIMITS[name]
        parser.add_argument(
            f"--{name}", type=between(100 * low, 100 * high, "percent"), metavar="PERCENT", help=f"{meaning}"
        )
    low, high = LIMITS["until"]
    parser.add_argument(
        "--until", type=between(100 * low, 100 * high, "percent"), metavar="PERCENT",
        help="a rest ends at this difference",
    )  # fmt: skip
    parser.add_argument(
        "--temperature", type=between(*LIMITS["ambient_degc"], "degC"), metavar="DEGC", help="of the air around"
    )
    parser.add_argument(
        "--resistor", type=between(*LIMITS["resistor_ohm"], "ohm"), metavar="OHM", help="bleed resistor"
    )
    low, high = LIMITS["threshold_v"]
    parser.add_argument(
        "--threshold", type=between(1e3 * low, 1e3 * high, "mV"), metavar="MV",
        help="a charging cell bleeds where it stands above the lowest by more",
    )  # fmt: skip
    parser.add_argument("--seed", type=int, help="which cell is high, and the cells' scatter (default: 1)")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="draw the courses; needs the extra voltwall[plot]")
    parser.add_argument("--json", action="store_true", help="print figures and courses as JSON")
