"""The build of a service's lake as a program: DATA LAKE NICE. It imports less than `voltwall season build` does."""

import os
import sys
from pathlib import Path

from app.errors import AppError
from app.season.lake.build import build_lake, session_files
from app.season.lake.place import Place
from app.words import render


def main(data: str, lake: str, nice: str) -> None:
    """Build what is new; what it cannot is said on standard error, a line each."""
    if hasattr(os, "nice"):
        os.nice(int(nice))
    try:
        built = build_lake(Place(lake), session_files([Path(data, "sessions")]))
    except (AppError, OSError) as error:
        sys.exit(f"{lake}: {error}")
    for session, why in built.failed:
        sys.stderr.write(f"{session} is left out: {why if isinstance(why, str) else render(why)}\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
