"""A recorded CAN log as columns, whatever tool wrote it."""

from pathlib import Path

from app.sources.dbc.frames import Frames, frames_of
from app.sources.recordings.can_log import read_frames


def load_log(path: Path) -> Frames:
    """Return the frames of a log in the order of their time; time in ns since 1970, or since its begin.

    Raises:
        ImportFailed: the file cannot be read as what its name says.
    """
    return frames_of(sorted(((round(t_s * 1e9), can_id, data) for t_s, can_id, data in read_frames(path)), key=_time))


def _time(frame: tuple[int, int, bytes]) -> int:
    return frame[0]
