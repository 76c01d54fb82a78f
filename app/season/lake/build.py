"""Build of the lake from closed sessions: those that are new, changed, or made by an older version."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Final

from app.errors import AppError, message_of
from app.season.lake.facts import Facts, Where, facts_of, where_of
from app.season.lake.place import LakeFolder
from app.season.lake.schema import LAKE_VERSION, MARK, SAMPLES, TABLES, pyarrow_or_error
from app.season.lake.tables import (
    STATE_KEY,
    VERSION_KEY,
    about,
    layout_of,
    sample_table,
    write_facts,
    write_samples,
)
from app.sessions.info import UNDATED
from app.sessions.reading.reader import SessionFile
from app.sessions.storage.files import SUFFIX
from app.words import Message, Text

_ORDER: Final = (*(name for name in TABLES if name != MARK), MARK)


@dataclass
class Built:
    """Result of a build, by session id."""

    made: list[str] = field(default_factory=list)
    current: list[str] = field(default_factory=list)  # nothing to do
    not_closed: list[str] = field(default_factory=list)
    failed: list[tuple[str, Text]] = field(default_factory=list)  # damaged or without a date: left out, and why


def session_files(places: Iterable[Path]) -> list[Path]:
    """Return the session files in folders, and those named themselves, in order.

    A folder is one of sessions, or the data folder of a service.
    """
    paths: list[Path] = []
    for place in places:
        if place.is_dir():
            folder = place / "sessions" if (place / "sessions").is_dir() else place
            paths += sorted(folder.glob(f"*{SUFFIX}"))
        else:
            paths.append(place)
    return paths


def build_lake(
    lake: LakeFolder,
    paths: Sequence[Path],
    *,
    again: bool = False,
    judge_anew: bool = False,
    progress: Callable[[int, int, str], None] = lambda done, of, session: None,
) -> Built:
    """Bring a lake up to date with sessions.

    Args:
        lake: where it lies.
        paths: of session files.
        again: make those too that are up to date.
        judge_anew: judge every cell again instead of taking what was found while recording.
        progress: called with how many are done, of how many, and which comes next.

    Raises:
        OSError: the lake cannot be written.
        ExtraMissing: a package is not installed.
    """
    pyarrow_or_error()
    with lake.one_writer():
        return _build(lake, paths, again=again, judge_anew=judge_anew, progress=progress)


def build_new(lake: str, data: Path) -> list[Message]:
    """Bring the lake of a service up to date with its data folder; return which sessions are left out, and why.

    Raises:
        OSError: the lake cannot be written.
    """
    built = build_lake(LakeFolder(lake), session_files([data / "sessions"]))
    return [Message("of-source", source=session, reason=why) for session, why in built.failed]


def _build(
    lake: LakeFolder, paths: Sequence[Path], *, again: bool, judge_anew: bool, progress: Callable[[int, int, str], None]
) -> Built:
    states_before = {} if again else states(lake)
    built = Built()
    for k, path in enumerate(paths):
        progress(k, len(paths), path.stem)
        state = state_of(path)
        try:
            with SessionFile(path) as session:
                where = where_of(session)
                if not session.info.is_closed:
                    built.not_closed.append(path.stem)
                elif session.info.metadata.get(UNDATED):
                    built.failed.append((path.stem, Message("season-undated")))
                elif states_before.get(where) == state:
                    built.current.append(path.stem)
                else:
                    write_session(lake, session, facts_of(session, judge_anew=judge_anew), state)
                    built.made.append(path.stem)
        except (AppError, MemoryError) as error:  # the memory of a worker process is limited
            built.failed.append((path.stem, message_of(error)))
    return built


def write_session(lake: LakeFolder, session: SessionFile, facts: Facts, state: str) -> None:
    """Write the files of one session, the one that says that it is there last."""
    metadata = about(facts.where, state)
    folder = folder_of(facts.where)
    table = sample_table(session)
    lake.put(f"{folder}/{SAMPLES}.parquet", lambda path: write_samples(path, table, facts.where, metadata))
    for name in _ORDER:
        rows = facts.tables[name]
        if name == MARK:
            of_file = {"source_file": str(session.path), "source_state": state, "layout": layout_of(table)}
            rows = [dict(row) | of_file for row in rows]
        lake.put(f"{folder}/{name}.parquet", lambda path, name=name, rows=rows: write_facts(path, name, rows, metadata))  # type: ignore[misc]


def folder_of(where: Where) -> str:
    """Return a session's folder in the lake."""
    return "/".join(f"{name}={value}" for name, value in asdict(where).items())


def state_of(path: Path) -> str:
    """Return what changes when a session's file does: its time of change and its size."""
    try:
        stat = path.stat()
    except OSError:
        return "missing"
    return f"{stat.st_mtime_ns}-{stat.st_size}"


def states(lake: LakeFolder) -> dict[Where, str]:
    """Return of every session in a lake that this version has made: the state of its file then."""
    from pyarrow import ArrowInvalid, parquet

    state_of = {}
    for path in lake.find(f"car=*/season=*/session=*/{MARK}.parquet"):
        parts = [part.partition("=")[2] for part in path.split("/")[-4:-1]]
        try:
            metadata = parquet.read_metadata(path, filesystem=None if lake.is_local else lake.fs).metadata or {}
        except (ArrowInvalid, OSError):  # damaged: made again
            continue
        if metadata.get(VERSION_KEY) == str(LAKE_VERSION).encode():
            state_of[Where(*parts)] = metadata.get(STATE_KEY, b"").decode()
    return state_of
