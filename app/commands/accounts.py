"""`voltwall accounts`: people and programs that may come in; works beside a running service."""

import argparse
import getpass
import json
import os
import sys
from datetime import UTC, datetime
from functools import partial

from app.api.access.accounts import Accounts
from app.clock import Clock
from app.commands.console.signed_log import show
from app.commands.console.terminal import print_table
from app.configuration.history import ConfigHistory
from app.configuration.write_log import WriteLog
from app.errors import ConfigError
from app.service.settings import Settings
from app.telemetry import Severity
from app.words import Message, render

VARIABLE = "VOLTWALL_ACCOUNT_PASSWORD"


def run(args: argparse.Namespace) -> int:
    """Do what was asked for.

    Raises:
        ConfigError: a value is not allowed, or there is none of that name.
    """
    folder = getattr(args, "data", None) or Settings().data
    if args.action == "log":
        return show(folder, as_json=args.json)
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
            print(
                f"{token.name}: {token.role} until {_day(token.ends_s)}; this secret is not shown again",
                file=sys.stderr,
            )
        case "revoke":
            with signed(f"token {args.token}: revoked"):
                if not accounts.revoke_token(args.token):
                    raise ConfigError("token", args.token, Message("no-such-account"))
        case _ if args.json:
            people = [{"name": account.name, "role": account.role} for account in accounts.all()]
            tokens = [
                {
                    "id": each.id,
                    "name": each.name,
                    "role": each.role,
                    "ends": _day(each.ends_s),
                    "made_by": each.made_by,
                }
                for each in accounts.tokens()
            ]
            print(json.dumps({"accounts": people, "tokens": tokens}, indent=2))
        case _:
            rows = [(each.name, each.role, "", "", "") for each in accounts.all()]
            rows += [(each.name, each.role, each.id, _day(each.ends_s), each.made_by) for each in accounts.tokens()]
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
