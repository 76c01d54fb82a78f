"""A recorded CAN log as columns, whatever tool wrote it."""

from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.sources.dbc.frames import Frames, frames_of
from app.sources.recordings.can_log import OnRead, read_frames

AT_ONCE = 50_000  # frames that become columns: as Python's objects each takes 300 bytes, in columns 21


def load_log(path: Path, on_read: OnRead = lambda at: None) -> Frames:
    """Return the frames of a log in the order of their time; time in ns since 1970, or since its begin.

    `on_read` is told how many bytes are read, again and again.

    Raises:
        ImportFailed: the file cannot be read as what its name says.
    """
    frames = ((round(t_s * 1e9), can_id, data) for t_s, can_id, data in read_frames(path, on_read=on_read))
    parts = [frames_of([])]
    while part := list(islice(frames, AT_ONCE)):
        parts.append(frames_of(part))
    width = max(part.data.shape[1] for part in parts)
    t_ns = np.concatenate([part.t_ns for part in parts])
    order = np.argsort(t_ns, kind="stable")
    return Frames(
        t_ns[order],
        np.concatenate([part.can_id for part in parts])[order],
        np.concatenate([part.length for part in parts])[order],
        np.concatenate([_wide(part.data, width) for part in parts])[order],
    )


def _wide(data: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    """The bytes of classic CAN beside those of CAN FD: zero beyond their own."""
    return np.pad(data, ((0, 0), (0, width - data.shape[1])))
