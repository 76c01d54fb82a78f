"""`voltwall export`: a session's signals as a file for another program."""

import argparse
from pathlib import Path

from app.commands.arguments.common import add_data_argument, add_session_argument
from app.commands.arguments.work import Work
from app.sessions.export.formats import FORMATS, NAMES, Format


def meaning_of(export_format: Format) -> str:
    """Return what a format is, and what it needs."""
    needs = f" (needs {', '.join(export_format.needs)})" if export_format.needs else ""
    return f"{export_format.name}, {export_format.meaning}{needs}"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.set_defaults(do=Work("export.run"))
    add_session_argument(parser)
    parser.add_argument(
        "--format",
        choices=tuple(FORMATS),
        help="\n".join(f"{name:8} {meaning_of(each)}" for name, each in FORMATS.items())
        + "\nwithout it, what the ending of --out says",
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FILE", help="the file to write; - is standard output"
    )
    parser.add_argument("--force", action="store_true", help="overwrite a file that is there")
    parser.add_argument(
        "--from", dest="t_from", metavar="TIME", help="start: +SECONDS into the session, or ISO 8601 in UTC"
    )
    parser.add_argument("--to", dest="t_to", metavar="TIME", help="end, included; written like --from")
    parser.add_argument(
        "--signal",
        action="append",
        metavar="NAME",
        help="a signal, as v[36], i_fs, slave[3].cvr[5], conf.ts, estimate.soc[36]; may be repeated.\n"
        "Without it: voltages, temperatures, current, the master's SOC and the estimates",
    )
    parser.add_argument(
        "--names",
        choices=NAMES,
        default="index",
        help="what csv, parquet, mf4, ld and motec call the signals: index: v[36], counted from 0;\n"
        "number: v_037, from 1; pack: pack4_cell1_v, from 1. Without it: index",
    )
    add_data_argument(parser)
