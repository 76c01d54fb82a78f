"""One service a data folder: two would write the same EEPROM file and the same event log."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from app.errors import ConfigError
from app.words import Message


@contextmanager
def locked_folder(folder: Path) -> Iterator[None]:
    """Create the folder and hold its lock; the system releases it when the process dies.

    Raises:
        ConfigError: the folder cannot be written, or another service has it.
    """
    lock = FileLock(folder / "lock", timeout=0)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except Timeout as error:
        raise ConfigError("data", folder, Message("folder-in-use")) from error
    except OSError as error:
        raise ConfigError("data", folder, error.strerror or str(error)) from error
    try:
        yield
    finally:
        lock.release()
