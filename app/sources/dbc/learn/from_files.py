"""`learn` of files as they were uploaded."""

from collections.abc import Mapping

from app.sources.dbc.dbc_file import parse_definitions
from app.sources.dbc.definitions import Definitions
from app.sources.dbc.frames import Frames
from app.sources.dbc.learn.learning import Learned, learn
from app.sources.dbc.learn.survey import Survey, survey


def learn_from_files(files: Mapping[str, str], frames: Frames, name: str) -> tuple[int, Survey, Learned | None]:
    """Return how many messages the files define, what was heard of them, and the profile that they suggest.

    Args:
        files: message definitions as text, by file name.
        frames: what was heard.
        name: of the profile; the first file's where empty.

    Raises:
        ImportFailed, ExtraMissing: a file cannot be read.
    """
    definitions = Definitions(())
    for each, text in files.items():
        definitions = definitions.joined(parse_definitions(text.encode(), each))
    found = survey(definitions, frames)
    learned = learn(found, frames, name or next(iter(files)).rpartition(".")[0], tuple(files))
    return len(definitions.messages), found, learned
