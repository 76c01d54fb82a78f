"""`voltwall config`: the master's configuration through a running service, for scripts."""

import argparse
from functools import partial
from pathlib import Path

from app.commands.arguments.common import add_json_argument, add_trust_argument
from app.commands.arguments.work import Work
from app.words import Message, render

_URL = "http://127.0.0.1:8000"
_EPILOG = f"""\
SOURCE is {render(Message("source-names"))}.
Exit codes: 0 done; 1 diff or compare found differences; 2 refused or not allowed; 3 service or master not reachable,
or no right to; 4 somebody else changed the configuration meanwhile; 5 sent and not verified: read again.
Where the service wants a password: VOLTWALL_PASSWORD in the environment, with VOLTWALL_NAME where it is an account's,
or an API token in VOLTWALL_PASSWORD."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Actions and where the service is."""
    parser.set_defaults(do=Work("config.run"))
    where = argparse.ArgumentParser(add_help=False, argument_default=argparse.SUPPRESS)
    where.add_argument("--url", help=f"the running service (default: {_URL})")
    parser.add_argument("--url", default=_URL, help="the running service (default: %(default)s)")
    add_trust_argument(where)
    add_trust_argument(parser)
    parser.epilog = _EPILOG
    add = partial(parser.add_subparsers(dest="action", metavar="ACTION", required=True).add_parser, parents=[where])
    read = add("read", help="print a configuration as JSON in units, or save it")
    read.add_argument(
        "source", nargs="?", default="in-force", metavar="SOURCE", help="where from (default: %(default)s)"
    )
    read.add_argument("--out", type=Path, metavar="FILE", help="save to FILE: .json as JSON, anything else as image")
    diff = add("diff", help="what a write would change, and what the rules say; exit code 1 if anything")
    write = add("write", help="check, write, read back byte for byte")
    for action in (diff, write):
        action.add_argument(
            "edits",
            nargs="+",
            metavar="EDIT",
            help="FIELD=VALUE as telemetry_period=50, a file (image, profile, JSON of values), or a SOURCE",
        )
        action.add_argument("--reason", default="", help="why it is right in spite of warnings")
    write.add_argument("--store", action="store_true", help="then store in the EEPROM and read it back")
    compare = add("compare", help="what differs between two SOURCEs; exit code 1 if anything")
    compare.add_argument("a", metavar="FROM", help="a SOURCE, as stored")
    compare.add_argument("b", metavar="TO", help="a SOURCE, as in-force")
    for action in (diff, compare):
        add_json_argument(action, default=False)
    add("store", help="store what is in force in the EEPROM and read it back")
    add("load", help="put what the EEPROM holds in force")
    rollback = add("rollback", help="put back what was in force before a write")
    rollback.add_argument("record", nargs="?", type=int, help="number in the history (default: the last write)")
    rollback.add_argument("--reason", default="", help="why")
    history = add("history", help="every write: who, when, what, why, with what result")
    history.add_argument("--json", action="store_true", help="as JSON")
    profiles = add("profiles", help="named configurations: list, save, get, put, delete")
    profiles.add_argument(
        "what", nargs="?", choices=("list", "save", "get", "put", "delete"), default="list", help="default: list"
    )
    profiles.add_argument("name", nargs="?", help="of the profile; get: NAME or NAME@VERSION; put: its FILE")
    profiles.add_argument("--from", dest="source", default="in-force", metavar="SOURCE", help="save: default in-force")
    profiles.add_argument("--as", dest="new_name", metavar="NAME", help="put: another name than the file says")
    profiles.add_argument("--comment", help="save, put: what it is for")
    profiles.add_argument("--json", action="store_true", help="list: as JSON")
    profiles.add_argument("--out", type=Path, metavar="FILE", help="get: where to (default: standard output)")
