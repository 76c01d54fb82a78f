"""`learn` of files as they were uploaded."""

from collections.abc import Mapping
from pathlib import Path

from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.definitions import Definitions
from app.sources.dbc.frames import Frames
from app.sources.dbc.learn.lesson import Correction, Lesson
from app.sources.dbc.log_file import load_log


def lesson_from_files(files: Mapping[str, str], heard: Frames | Path, name: str) -> Lesson:
    """Return a lesson of files, with the profile that they suggest.

    Args:
        files: message definitions as text, by file name.
        heard: frames of a bus, or a CAN log.
        name: of the profile; the first file's where empty.

    Raises:
        ImportFailed, ExtraMissing: a file cannot be read.
    """
    definitions = Definitions(())
    for each, text in files.items():
        definitions = definitions.joined(parse_definitions(text.encode(), each))
    frames = load_log(heard) if isinstance(heard, Path) else heard
    lesson = Lesson(definitions, tuple(files), frames, name or Path(next(iter(files))).stem)
    lesson.learned(Correction())
    return lesson
