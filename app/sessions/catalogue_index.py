"""An index of a folder's finished sessions, kept next to them, so that a season is listed without opening it.

Only a shortcut: whoever finds it damaged, old or absent opens the sessions. A file that has changed since, by its time
or its size, is opened again.
"""

import contextlib
import json
import os
import tempfile
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

from app.sessions.info import SessionInfo
from app.sessions.storage.files import SUFFIX
from app.sources.data_file import MOST_DEPTH, checked, parse_object, set_aside

INDEX = ".index.json"
_VERSION = 1
MOST_BYTES = 256 << 20
State = tuple[int, int]  # a file's change time [ns since 1970] and bytes
FullState = tuple[int, int, int, int]  # state of a file and of its log
Known = dict[str, tuple[State, SessionInfo]]


def full_state(path: Path) -> FullState:
    """Return when a session's file and its log were changed, and their sizes; zeros without a log.

    Raises:
        OSError: there is no such file.
    """
    file = path.stat()
    try:
        log_file = path.with_name(path.name + "-wal").stat()
    except OSError:
        return file.st_mtime_ns, file.st_size, 0, 0
    return file.st_mtime_ns, file.st_size, log_file.st_mtime_ns, log_file.st_size


def load_index(folder: Path) -> Known:
    """Return what was kept, nothing where there is none that can be used."""
    path = folder / INDEX
    try:
        kept = parse_object(path.read_bytes(), most_bytes=MOST_BYTES, most_depth=MOST_DEPTH + 4)
        if kept["version"] != _VERSION:
            return {}
        return {
            session_id: ((int(row["changed_ns"]), int(row["bytes"])), _info(folder, session_id, row["info"]))
            for session_id, row in kept["sessions"].items()
        }
    except OSError:
        return {}
    except (ValueError, TypeError, KeyError, AttributeError):
        with contextlib.suppress(OSError):
            set_aside(path)
        return {}


def save_index(folder: Path, indexed: Mapping[str, tuple[State, SessionInfo]]) -> None:
    """Keep it; nothing where the folder takes none."""
    rows = {
        session_id: {"changed_ns": state[0], "bytes": state[1], "info": asdict(info) | {"path": info.path.name}}
        for session_id, (state, info) in indexed.items()
    }
    with contextlib.suppress(OSError):
        handle, name = tempfile.mkstemp(prefix=INDEX, dir=folder)
        try:
            with os.fdopen(handle, "w", encoding="utf-8") as file:
                json.dump({"version": _VERSION, "sessions": rows}, file)
            Path(name).replace(folder / INDEX)
        except OSError:
            Path(name).unlink(missing_ok=True)


def _info(folder: Path, session_id: str, row: Mapping[str, object]) -> SessionInfo:
    """The facts of a session.

    Raises:
        TypeError: one is of another kind, or not known.
    """
    return checked(SessionInfo(**{**row, "id": session_id, "path": folder / f"{session_id}{SUFFIX}"}))  # type: ignore[arg-type]
