"""`voltwall drill`: bad days without names, for the crew at a running service, or for the product by itself."""

import argparse

from app.analysis.drill.days import DAYS, POOL
from app.commands.arguments.common import add_trust_argument
from app.commands.arguments.work import Work
from app.commands.console.number import between
from app.estimation.cell_model.default_cell import DEFAULT_CELL

SEEDS = 1_000_000
EPILOG = """\
Without --product it needs `voltwall serve` on the simulated car: look at its pages, answer here or on its Simulator
page. Two points for what failed, one for where.

exit code of --product with --pass: 1 where the product has fewer points than that share of them
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which days, who answers."""
    parser.set_defaults(do=Work("drill.run"))
    parser.epilog = EPILOG
    parser.add_argument("--seed", type=int, metavar="N", help=f"the same days again, 0 to {SEEDS} (default: random)")
    parser.add_argument(
        "--days", type=int, default=DAYS, choices=range(1, len(POOL) + 1), metavar="N", help="how many (default: 10)"
    )
    parser.add_argument("--url", default="http://127.0.0.1:8000", help="of the service (default: %(default)s)")
    add_trust_argument(parser)
    parser.add_argument("--product", action="store_true", help="nobody answers: score what the product itself says")
    parser.add_argument(
        "--speed", type=between(1, 100, "times real time"), default=15.0, help="with --product (default: %(default)g)"
    )
    parser.add_argument("--cell", default=DEFAULT_CELL, metavar="CELL.toml", help="with --product: the cell file")
    parser.add_argument(
        "--pass", dest="share", type=between(0, 1, "of the points"), metavar="SHARE", help="with --product: to pass"
    )
    parser.add_argument("--json", action="store_true", help="the debrief as JSON")
