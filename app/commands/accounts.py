"""`voltwall accounts`: people and programs that may come in; works next to a running service."""

from __future__ import annotations

import argparse
import getpass
import json
import os
import sys
from dataclasses import asdict
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from app.api.access.roles import MOST_DAYS, ROLES
from app.clock import Clock
from app.commands.arguments import data_folder, described
from app.commands.console import print_table
from app.errors import ConfigError
from app.words import Message, render
from firmware_protocol.config_image import image_hash
from firmware_protocol.memory_map import CONFIG_SIZE

if TYPE_CHECKING:
    from app.configuration.history import Record
    from app.telemetry import Severity

VARIABLE = "VOLTWALL_ACCOUNT_PASSWORD"
NOT_GENUINE = 1
EPILOG = """\
The password is prompted for; without a terminal it is read from VOLTWALL_ACCOUNT_PASSWORD. A viewer reads, an
engineer also writes and sends commands, a chief (admin) also manages users and tokens. The secret of a token is shown
once; programs send it as `Authorization: Bearer SECRET`, or instead of a password."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The actions."""
    parser.set_defaults(run=run)
    parser.epilog = EPILOG
    where = argparse.ArgumentParser(add_help=False, argument_default=argparse.SUPPRESS)
    where.add_argument("--data", type=Path, metavar="DIR", help="data folder of the service (default: that of serve)")
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    listing = actions.add_parser("list", parents=[where], **described("list users and tokens"))
    listing.add_argument("--json", action="store_true", help="print JSON")
    add = actions.add_parser("add", parents=[where], **described("add a user, or change role and password"))
    remove = actions.add_parser("remove", parents=[where], **described("remove a user and log them out"))
    token = actions.add_parser("token", parents=[where], **described("create an API token for a program"))
    revoke = actions.add_parser("revoke", parents=[where], **described("revoke a token"))
    log = actions.add_parser(
        "log",
        parents=[where],
        **described("show the signed log and check every signature; exit code 1 if one is invalid"),
    )
    log.add_argument("--json", action="store_true", help="print JSON, one line per record")
    for action in (add, remove, token):
        action.add_argument("name", metavar="NAME", help="name of the user or program")
    add.add_argument("--role", choices=ROLES, required=True, help="role of the user")
    token.add_argument("--role", choices=ROLES[:2], default="viewer", help="role of the token (default: %(default)s)")
    token.add_argument(
        "--days", type=float, default=30.0, help=f"validity in days, at most {MOST_DAYS} (default: %(default)g)"
    )
    revoke.add_argument("token", metavar="ID", help="ID shown by list")


def run(args: argparse.Namespace) -> int:
    """Do what was asked for.

    Raises:
        ConfigError: a value is not allowed, or there is none of that name.
    """
    from app.api.access.accounts import Accounts
    from app.configuration.history import ConfigHistory
    from app.configuration.write_log import WriteLog

    folder = data_folder(args)
    if args.action == "log":
        return _show_log(folder, as_json=args.json)
    folder.mkdir(parents=True, exist_ok=True)
    accounts, clock = Accounts(folder), Clock()
    signed = partial(WriteLog(ConfigHistory(folder), _tell, clock, patience=20.0).signed, "command line", "access")
    match args.action:
        case "add":
            password = _password()
            with signed(f"account {args.name}: {args.role}, new password"):
                made = accounts.put(args.name, args.role, password)
            print(f"{made.name}: {made.role}")
        case "remove":
            with signed(f"account {args.name}: removed"):
                if not accounts.remove(args.name):
                    raise ConfigError("name", args.name, Message("no-such-account"))
        case "token":
            with signed(f"token {args.name}: {args.role}, {args.days:g} days"):
                token, secret = accounts.make_token(args.name, args.role, args.days, "command line", clock.wall_s())
            print(secret)
            ends = _day(token.ends_s)
            print(f"{token.name}: {token.role} until {ends}; this secret is not shown again", file=sys.stderr)
        case "revoke":
            with signed(f"token {args.token}: revoked"):
                if not accounts.revoke_token(args.token):
                    raise ConfigError("token", args.token, Message("no-such-account"))
        case _ if args.json:
            people = [{"name": account.name, "role": account.role} for account in accounts.all()]
            names = ("id", "name", "role", "made_by")
            tokens = [
                {n: getattr(token, n) for n in names} | {"ends": _day(token.ends_s)} for token in accounts.tokens()
            ]
            print(json.dumps({"accounts": people, "tokens": tokens}, indent=2))
        case _:
            rows = [(account.name, account.role, "", "", "") for account in accounts.all()]
            rows += [
                (token.name, token.role, token.id, _day(token.ends_s), token.made_by) for token in accounts.tokens()
            ]
            print_table(("name", "role", "token", "until", "made by"), rows)
    return 0


def _tell(severity: Severity, code: str, message: Message, who: str | None = None) -> None:
    print(render(message), file=sys.stderr)


def _password() -> str:
    if (given := os.environ.get(VARIABLE)) is not None:
        return given
    if not sys.stdin.isatty():
        raise ConfigError("password", Message("not-given"), VARIABLE)
    first = getpass.getpass("Password: ")
    if getpass.getpass("Again: ") != first:
        raise ConfigError("password", Message("hidden"), Message("passwords-differ"))
    return first


def _day(unix_s: float) -> str:
    return datetime.fromtimestamp(unix_s, UTC).strftime("%Y-%m-%d")


def _show_log(folder: Path, *, as_json: bool) -> int:
    """Print the signed log, oldest first, signatures checked; return 1 where one is not genuine.

    Raises:
        ConfigError: there is no log, or it cannot be read.
    """
    from app.configuration.history import ConfigHistory

    try:
        records = ConfigHistory(folder).records()
    except OSError as error:
        raise ConfigError("data", folder, error.strerror or str(error)) from error
    if not records:
        raise ConfigError("data", folder, Message("no-signed-log"))
    for record in records:
        print(json.dumps(_json(record)) if as_json else _line(record))
    wrong = [record.number for record in records if not record.is_genuine]
    verdict = f"not genuine: {', '.join(map(str, wrong))}" if wrong else "all signatures right"
    print(f"{len(records)} records; {verdict}", file=sys.stderr)
    return NOT_GENUINE if wrong else 0


def _line(record: Record) -> str:
    from app.configuration.history import BEGUN, CONFIG_ACTIONS

    time = datetime.fromtimestamp(record.t_wall_ns / 1e9, UTC).strftime("%Y-%m-%d %H:%M:%S")
    images = f" {_hash(record.before)} -> {_hash(record.after)}" if record.action in CONFIG_ACTIONS else ""
    reason = f" ({record.reason})" if record.reason else ""
    result = "no outcome is known" if record.result == BEGUN else record.result
    genuine = "" if record.is_genuine else "  NOT GENUINE"
    return f"{record.number} {time} {record.who}: {record.action} {record.source}{images}{reason}: {result}{genuine}"


def _json(record: Record) -> dict[str, object]:
    return asdict(record) | {"before": _hash(record.before), "after": _hash(record.after)}


def _hash(image: bytes) -> str | None:
    return image_hash(image) if len(image) == CONFIG_SIZE else None
