"""`voltwall export`: a session's signals as a file for another program."""

import argparse
import shutil
import sys
from contextlib import nullcontext, suppress
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory

from app.analysis.laps.from_session import lap_times
from app.commands.console.progress import Progress
from app.commands.session_commands.selection import find_session
from app.errors import ConfigError
from app.sessions.export.export import export
from app.sessions.export.formats import FORMATS
from app.sessions.reading.reader import SessionFile

STANDARD_OUTPUT = Path("-")


def run(args: argparse.Namespace) -> int:
    """Write the file.

    Raises:
        AppError: the session, a signal, the format or a time is not there or not understood.
    """
    name = args.format or next((n for n, each in FORMATS.items() if args.out.name.endswith(each.suffix)), None)
    if name is None:
        raise ConfigError("out", args.out.name, "the ending is no format's: say --format")
    is_piped = args.out == STANDARD_OUTPUT
    with TemporaryDirectory() if is_piped else nullcontext() as folder:
        path = args.out if folder is None else Path(folder, f"export{FORMATS[name].suffix}")
        with_laps = path.with_suffix(".ldx") if name == "ld" and not is_piped else None
        for file in (path, with_laps):
            if file is not None and file.is_file() and not args.force:
                raise ConfigError("out", file, "is there already: --force overwrites it")
        has_laps = _export(args, name, path, with_laps)
        if is_piped:
            with path.open("rb") as made:
                shutil.copyfileobj(made, sys.stdout.buffer)
            sys.stdout.flush()
        else:
            print(f"{path}: {path.stat().st_size / 1e6:.1f} MB")
            if with_laps is not None:
                text = "the laps" if has_laps else "not written: no lap was settled, marked or seen in this range"
                print(f"{with_laps}: {text}")
    return 0


def _export(args: argparse.Namespace, name: str, path: Path, with_laps: Path | None) -> bool:
    """Write the file, and the one with the laps beside it; return whether there are any."""
    with SessionFile(find_session(args, args.session)) as session:
        t_from_s, t_to_s = (
            _unix_s(session, option, text) for option, text in (("from", args.t_from), ("to", args.t_to))
        )
        if t_from_s is not None and t_to_s is not None and t_to_s < t_from_s:
            raise ConfigError("to", args.t_to, f"not before --from {args.t_from}")
        try:
            laps = lap_times(session) if FORMATS[name].has_laps else None
            wanted = {
                "signals": args.signal,
                "t_from_s": t_from_s,
                "t_to_s": t_to_s,
                "lap_times_s": laps,
                "names": args.names,
            }
            progress = Progress(path.name)
            export(session, path, name, on_progress=progress, **wanted)
            progress.end()
            if with_laps is not None:
                with suppress(ConfigError):  # no lap in this range
                    export(session, with_laps, "ldx", **wanted)
                    return True
        except OSError as error:
            raise ConfigError("out", args.out, error.strerror or str(error)) from error
    return False


def _unix_s(session: SessionFile, option: str, text: str | None) -> float | None:
    if text is None:
        return None
    try:
        if text.startswith("+"):
            return session.info.started_wall_ns / 1e9 + float(text)
        time = datetime.fromisoformat(text)
    except ValueError as error:
        raise ConfigError(option, text, "+SECONDS from the start, or ISO 8601 like 2026-07-14T10:30:00Z") from error
    return (time if time.tzinfo else time.replace(tzinfo=UTC)).timestamp()
