"""What the actions read: definitions of all DBCs of a profile, the frames of a log."""

from collections.abc import Iterable
from pathlib import Path

from app.battery.library import bundled_profiles, load_profile
from app.commands.console.progress import Progress
from app.errors import ConfigError
from app.sources.dbc.dbc_file import load_definitions
from app.sources.dbc.definitions import Definitions
from app.sources.dbc.frames import Frames
from app.sources.dbc.log_file import load_log


def existing(field: str, path: Path) -> Path:
    """Return a file that is there.

    Raises:
        ConfigError: there is none.
    """
    if not path.is_file():
        raise ConfigError(field, path, "no such file")
    return path


def definitions_of(files: Iterable[Path]) -> Definitions:
    """Return the messages of files, the first one's first.

    Raises:
        ExtraMissing, ImportFailed: a file cannot be read.
        ConfigError: a file is missing.
    """
    found = Definitions(())
    for file in files:
        found = found.joined(load_definitions(existing("dbc", file)))
    return found


def bundled_definitions() -> dict[str, tuple[Path, ...]]:
    """Return the DBC files of each bundled profile that has some."""
    found = {}
    for name in bundled_profiles():
        try:
            files = load_profile(name).dbc_files
        except ConfigError:  # a part, no whole battery
            continue
        if files:
            found[name] = files
    return found


def log_frames(path: Path) -> Frames:
    """Return the frames of a log; the terminal is told how far it is read.

    Raises:
        ConfigError: there is no such file.
        ImportFailed: it cannot be read.
    """
    size = existing("log", path).stat().st_size
    progress = Progress(path.name)
    frames = load_log(path, lambda at: progress(at, size))
    progress.end()
    return frames
