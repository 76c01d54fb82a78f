"""Session files as files: making one, its size, whether somebody has it open."""

import hashlib
import os
import sqlite3
from datetime import UTC, datetime
from pathlib import Path

from app.sessions.storage.database import code_of

SUFFIX = ".sqlite"
FETCHED = ".fetched"  # behind the name of a session from another service: how long it was there


def new_file(folder: Path, wall_ns: int, *, neighbour: Path | None = None) -> Path:
    """Create an empty file named by UTC time, with a number where that name is taken, or is `neighbour`."""
    folder.mkdir(parents=True, exist_ok=True)
    stem = datetime.fromtimestamp(wall_ns / 1e9, UTC).strftime("%Y%m%dT%H%M%SZ")
    number = 1
    while True:
        path = folder / (f"{stem}{SUFFIX}" if number == 1 else f"{stem}-{number}{SUFFIX}")
        if path == neighbour:
            number += 1
            continue
        try:
            os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o644))
        except FileExistsError:
            number += 1
        else:
            return path


def remove(path: Path) -> None:
    """Delete a session with its log."""
    for name in (path.name, f"{path.name}-wal", f"{path.name}-shm", path.name + FETCHED):
        path.with_name(name).unlink(missing_ok=True)


def size_on_disk(path: Path) -> int:
    """Bytes of a session's file and of its log."""
    size = 0
    for part in (path, path.with_name(path.name + "-wal")):
        try:
            size += part.stat().st_size
        except FileNotFoundError:
            continue
    return size


def is_in_use(path: Path) -> bool:
    """Return whether another connection, of this or another process, has the file open: being recorded, or read."""
    connection = sqlite3.connect(f"{path.resolve().as_uri()}?mode=rw", uri=True, timeout=0, isolation_level=None)
    try:
        connection.execute("PRAGMA locking_mode = EXCLUSIVE")
        connection.execute("BEGIN EXCLUSIVE")
        connection.execute("ROLLBACK")
    except sqlite3.DatabaseError as error:
        return code_of(error) in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)
    finally:
        connection.close()
    return False


def merge_log(path: Path) -> bool:
    """Bring what a cut-off recorder left in the log into the file, so that the file is all of it; whether it is.

    A file that somebody has open, or that cannot be written, stays as it is.
    """
    log = path.with_name(path.name + "-wal")
    if not log.exists():
        return True
    if is_in_use(path):
        return False
    connection = sqlite3.connect(f"{path.resolve().as_uri()}?mode=rw", uri=True, timeout=0, isolation_level=None)
    try:
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        connection.execute("PRAGMA journal_mode = DELETE")
    except sqlite3.DatabaseError:
        return False
    finally:
        connection.close()
    return not log.exists()


def sha256(path: Path) -> bytes:
    """Return the digest of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").digest()
