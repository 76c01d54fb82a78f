"""`voltwall export`: a session's signals as a file for another program."""

from __future__ import annotations

import argparse
import shutil
import sys
from contextlib import nullcontext, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from app.commands.arguments import add_data_argument, add_session_argument, find_session, unix_s
from app.commands.console import Progress
from app.errors import ConfigError
from app.sessions.export.formats import FORMATS, NAMES, Format
from app.words import Message

if TYPE_CHECKING:
    from app.sessions.reading.reader import SessionFile

STANDARD_OUTPUT = Path("-")


def meaning_of(export_format: Format) -> str:
    """Return what a format is, and what it needs."""
    needs = f" (needs {', '.join(export_format.needs)})" if export_format.needs else ""
    return f"{export_format.name}, {export_format.meaning}{needs}"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.set_defaults(run=run)
    add_session_argument(parser)
    parser.add_argument(
        "--format",
        choices=tuple(FORMATS),
        help="\n".join(f"{name:8} {meaning_of(export_format)}" for name, export_format in FORMATS.items())
        + "\n(default: from the file ending of --out)",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="file to write, - for standard output")
    parser.add_argument("--force", action="store_true", help="overwrite an existing file")
    parser.add_argument(
        "--from", dest="t_from", metavar="TIME", help="start: +SECONDS into the session, or ISO 8601 in UTC"
    )
    parser.add_argument("--to", dest="t_to", metavar="TIME", help="end (inclusive), same format as --from")
    parser.add_argument(
        "--signal",
        action="append",
        metavar="NAME",
        help="signal, such as v[36], i_fs, slave[3].cvr[5], conf.ts, estimate.soc[36]; repeatable\n"
        "(default: voltages, temperatures, current, master SOC and estimates)",
    )
    parser.add_argument(
        "--names",
        choices=NAMES,
        default="index",
        help="signal names in csv, parquet, mf4, ld and motec: index: v[36], from 0;\n"
        "number: v_037, from 1; pack: pack4_cell1_v, from 1 (default: index)",
    )
    add_data_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Write the file.

    Raises:
        AppError: the session, a signal, the format or a time is not there or not understood.
    """
    name = args.format or next(
        (n for n, export_format in FORMATS.items() if args.out.name.endswith(export_format.suffix)), None
    )
    if name is None:
        raise ConfigError("out", args.out.name, Message("export-ending"))
    is_piped = args.out == STANDARD_OUTPUT
    with TemporaryDirectory() if is_piped else nullcontext() as folder:
        path = args.out if folder is None else Path(folder, f"export{FORMATS[name].suffix}")
        with_laps = path.with_suffix(".ldx") if name == "ld" and not is_piped else None
        for file in (path, with_laps):
            if file is not None and file.is_file() and not args.force:
                raise ConfigError("out", file, Message("export-there"))
        has_laps = _export(args, name, path, with_laps)
        if is_piped:
            with path.open("rb") as made:
                shutil.copyfileobj(made, sys.stdout.buffer)
            sys.stdout.flush()
        else:
            print(f"{path}: {path.stat().st_size / 1e6:.1f} MB")
            if with_laps is not None:
                text = "the laps" if has_laps else "not written: no saved, marked or detected lap in this range"
                print(f"{with_laps}: {text}")
    return 0


def _export(args: argparse.Namespace, name: str, path: Path, with_laps: Path | None) -> bool:
    """Write the file, and the one with the laps next to it; return whether there are any."""
    from app.analysis.laps.from_session import lap_times
    from app.sessions.export.export import export
    from app.sessions.reading.reader import SessionFile

    with SessionFile(find_session(args, args.session)) as session:
        t_from_s, t_to_s = _unix_s(session, "from", args.t_from), _unix_s(session, "to", args.t_to)
        if t_from_s is not None and t_to_s is not None and t_to_s < t_from_s:
            raise ConfigError("to", args.t_to, Message("not-before-from", start=args.t_from))
        laps = lap_times(session) if FORMATS[name].has_laps else None
        wanted = {"signals": args.signal, "t_from_s": t_from_s, "t_to_s": t_to_s, "lap_times_s": laps}
        try:
            with Progress(path.name) as progress:
                export(session, path, name, on_progress=progress, names=args.names, **wanted)
            if with_laps is not None:
                with suppress(ConfigError):  # no lap in this range
                    export(session, with_laps, "ldx", names=args.names, **wanted)
                    return True
        except OSError as error:
            raise ConfigError("out", args.out, error.strerror or str(error)) from error
    return False


def _unix_s(session: SessionFile, option: str, text: str | None) -> float | None:
    if text is None:
        return None
    if text.startswith("+"):
        try:
            return session.info.started_wall_ns / 1e9 + float(text)
        except ValueError as error:
            raise ConfigError(option, text, Message("time-of-session")) from error
    return unix_s(option, text, Message("time-of-session"))
