"""`voltwall accounts`: people and programs that may come in; works beside a running service."""

import argparse
from pathlib import Path

from app.api.access.roles import MOST_DAYS, ROLES
from app.commands.arguments.work import Work

EPILOG = """\
The password is asked for; without a terminal it is read from VOLTWALL_ACCOUNT_PASSWORD. A viewer reads, an engineer
writes and commands, a chief manages accounts and tokens too. A token's secret is shown once; programs send it as
`Authorization: Bearer SECRET`, or in the place of a password."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The actions."""
    parser.set_defaults(do=Work("accounts.run"))
    parser.epilog = EPILOG
    where = argparse.ArgumentParser(add_help=False, argument_default=argparse.SUPPRESS)
    where.add_argument("--data", type=Path, metavar="DIR", help="data folder of the service (default: as serve)")
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    listing = actions.add_parser("list", parents=[where], help="who has an account, and which tokens there are")
    listing.add_argument("--json", action="store_true", help="as JSON")
    add = actions.add_parser("add", parents=[where], help="add an account, or change its role and password")
    remove = actions.add_parser("remove", parents=[where], help="take an account away, and log that person out")
    token = actions.add_parser("token", parents=[where], help="make a token for a program")
    revoke = actions.add_parser("revoke", parents=[where], help="take a token away")
    log = actions.add_parser(
        "log",
        parents=[where],
        help="what they changed: the signed log, every signature checked; exit code 1 if one is wrong",
    )
    log.add_argument("--json", action="store_true", help="a line of JSON a record")
    for action in (add, remove, token):
        action.add_argument("name", metavar="NAME", help="of the person, or the program")
    add.add_argument("--role", choices=ROLES, required=True, help="what that person may do")
    token.add_argument("--role", choices=ROLES[:2], default="viewer", help="what it may do (default: %(default)s)")
    token.add_argument(
        "--days", type=float, default=30.0, help=f"until it ends, at most {MOST_DAYS} (default: %(default)g)"
    )
    revoke.add_argument("token", metavar="ID", help="as list shows it")
