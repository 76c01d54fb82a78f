"""What is known of a folder's finished sessions, kept beside them, so that a season is listed without opening it.

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

INDEX = ".index.json"
_VERSION = 1
State = tuple[int, int]  # of a file: when it was changed [ns since 1970], bytes
Known = dict[str, tuple[State, SessionInfo]]


def load_index(folder: Path) -> Known:
    """Return what was kept, nothing where there is none that can be used."""
    try:
        kept = json.loads((folder / INDEX).read_text(encoding="utf-8"))
        if kept["version"] != _VERSION:
            return {}
        return {
            session_id: ((int(row["changed_ns"]), int(row["bytes"])), _info(folder, row["info"]))
            for session_id, row in kept["sessions"].items()
        }
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        return {}


def save_index(folder: Path, known: Mapping[str, tuple[State, SessionInfo]]) -> None:
    """Keep it; nothing where the folder takes none."""
    rows = {
        session_id: {"changed_ns": state[0], "bytes": state[1], "info": asdict(info) | {"path": info.path.name}}
        for session_id, (state, info) in known.items()
    }
    with contextlib.suppress(OSError):
        handle, name = tempfile.mkstemp(prefix=INDEX, dir=folder)
        try:
            with os.fdopen(handle, "w", encoding="utf-8") as file:
                json.dump({"version": _VERSION, "sessions": rows}, file)
            Path(name).replace(folder / INDEX)
        except OSError:
            Path(name).unlink(missing_ok=True)


def _info(folder: Path, row: dict[str, object]) -> SessionInfo:
    return SessionInfo(**{**row, "path": folder / str(row["path"])})  # type: ignore[arg-type]
