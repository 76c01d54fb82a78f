"""`voltwall season build`: make the lake from closed sessions."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from app.commands.console.progress import Progress
from app.commands.session_commands.selection import data_folder
from app.errors import ConfigError
from app.season.lake.build import Built, build_lake, session_files
from app.season.lake.place import Place
from app.service.settings import Settings
from app.words import render


def build(args: argparse.Namespace) -> int:
    """Make the lake; 1 where a session was left out.

    Raises:
        ConfigError: the lake cannot be written.
    """
    places = args.places or [data_folder(args) / "sessions"]
    for place in places:
        if not place.exists():
            raise ConfigError("DIR", place, "a folder of sessions, or a session")
    lake = Place(lake_of(args))
    built = built_lake(lake, places, shows=sys.stderr.isatty(), again=args.again, judge_anew=args.judge)
    print(f"{lake.url}: {len(built.made)} made, {len(built.current)} up to date")
    if built.not_closed:
        print(f"not closed yet: {', '.join(built.not_closed)}")
    return 1 if built.failed else 0


def lake_of(args: argparse.Namespace) -> str:
    """Return where the lake of an action is."""
    return str(args.lake or Settings.model_validate({}).lake or data_folder(args) / "lake")


def built_lake(
    lake: Place, places: Sequence[Path], *, shows: bool, again: bool = False, judge_anew: bool = False
) -> Built:
    """Bring a lake up to date with the sessions of folders; say which are left out, and on a terminal how far it is.

    Raises:
        ConfigError: the lake cannot be written.
    """
    line = Progress("season lake", shows=shows)

    def progress(done: int, of: int, _session: str) -> None:
        line(done, of)

    try:
        built = build_lake(lake, session_files(places), again=again, judge_anew=judge_anew, progress=progress)
    except OSError as error:
        raise ConfigError("lake", lake.url, error.strerror or str(error)) from error
    line.end()
    for session, why in built.failed:
        print(f"{session} is left out: {why if isinstance(why, str) else render(why)}", file=sys.stderr)
    return built
