"""Results of sessions that were estimated again: one JSON file a session and set, next to the sessions.

    DATA/estimates/SET/set.json           what all results of the set have in common
    DATA/estimates/SET/SESSION.json       one session

A set is a cell file, a filter and a version of this program, so results of another never overwrite it. A file is
written whole under another name, brought to the disk, then renamed: after a kill it is the old one or the new one.
"""

from __future__ import annotations

import hashlib
import json
import os
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from app import __version__
from app.errors import ConfigError

SCHEMA: Final = 1
FOLDER: Final = "estimates"
OWN: Final = "session"  # in place of a cell file: each session's own
_SET = "set.json"


@dataclass(frozen=True)
class EstimateSet:
    """The inputs of a set of results; `cell_hash` of the cell file, "session" where each has its own."""

    cell_name: str
    cell_hash: str
    filter_name: str
    version: str

    @property
    def id(self) -> str:
        """The folder's name."""
        return f"{self.cell_hash}-{self.filter_name}-{self.version}"


def cell_hash(text: str) -> str:
    """Return what tells a cell file from another, by the text that `format_cell` makes of it."""
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def set_of(cell_name: str, cell_text: str | None, filter_name: str) -> EstimateSet:
    """Return the set that this version makes with a cell file; None is each session's own."""
    if cell_text is None:
        return EstimateSet(OWN, OWN, filter_name, __version__)
    return EstimateSet(cell_name, cell_hash(cell_text), filter_name, __version__)


class Results:
    """The results of a data folder."""

    def __init__(self, data: Path) -> None:
        self.folder = data / FOLDER

    def sets(self) -> list[EstimateSet]:
        """All sets, the newest first."""
        stored = []
        for path in self.folder.glob(f"*/{_SET}"):
            about = _read(path)
            if about is not None and about.pop("schema", None) == SCHEMA:
                with suppress(TypeError):  # damaged
                    stored.append((path.stat().st_mtime_ns, EstimateSet(**about)))
        return [estimate_set for _, estimate_set in sorted(stored, key=lambda pair: (-pair[0], pair[1].id))]

    def find(self, name: str) -> EstimateSet:
        """Return the newest set whose folder or cell has a name.

        Raises:
            ConfigError: there is none.
        """
        sets = self.sets()
        for estimate_set in sets:
            if name in (estimate_set.id, estimate_set.cell_name, estimate_set.cell_hash):
                return estimate_set
        raise ConfigError(
            "set", name, ", ".join(estimate_set.id for estimate_set in sets) or "voltwall season estimate makes one"
        )

    def begin(self, made: EstimateSet) -> None:
        """Make the folder of a set."""
        folder = self.folder / made.id
        folder.mkdir(parents=True, exist_ok=True)
        if not (folder / _SET).is_file():
            _write(folder / _SET, {"schema": SCHEMA, **asdict(made)})

    def write(self, made: EstimateSet, result: dict[str, Any]) -> None:
        """Keep the result of a session; one of before is replaced."""
        _write(self.folder / made.id / f"{result['session']}.json", result)

    def read(self, made: EstimateSet, session_id: str) -> dict[str, Any] | None:
        """Return the result of a session; None where there is none of this format, or a damaged one."""
        result = _read(self.folder / made.id / f"{session_id}.json")
        return result if result is not None and result.get("schema") == SCHEMA else None

    def read_all(self, made: EstimateSet) -> list[dict[str, Any]]:
        """Return all results of a set, the oldest session first."""
        names = sorted(path.stem for path in (self.folder / made.id).glob("*.json") if path.name != _SET)
        results = [result for name in names if (result := self.read(made, name)) is not None]
        return sorted(results, key=lambda result: (result["start_s"], result["session"]))

    def has(self, made: EstimateSet, session_id: str, content: str) -> bool:
        """Return whether there is a result of a session with this `SessionFile.content_digest`."""
        result = self.read(made, session_id)
        return result is not None and result.get("content") == content


def _read(path: Path) -> dict[str, Any] | None:
    try:
        result = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    return result if isinstance(result, dict) else None


def _write(path: Path, body: dict[str, Any]) -> None:
    half = path.with_name(f".{path.name}.{os.getpid()}")
    with half.open("w", encoding="utf-8") as file:
        json.dump(body, file, allow_nan=False, separators=(",", ":"))
        file.flush()
        os.fsync(file.fileno())
    half.replace(path)
