"""One service a data folder: two would write the same EEPROM file and the same event log."""

import os
from pathlib import Path
from types import TracebackType
from typing import IO

from app.errors import ConfigError

if os.name == "posix":
    import fcntl

    def _lock(file: IO[str]) -> None:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
else:
    import msvcrt

    def _lock(file: IO[str]) -> None:
        msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined,unused-ignore]


class FolderLock:
    """Held for the length of a with-block; the system releases it when the process dies."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._file: IO[str] | None = None

    def __enter__(self) -> "FolderLock":
        """Create the folder and take the lock.

        Raises:
            ConfigError: the folder cannot be written, or another service has it.
        """
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            self._file = (self._folder / "lock").open("w")
        except OSError as error:
            raise ConfigError("data", self._folder, error.strerror or str(error)) from error
        try:
            _lock(self._file)
        except OSError as error:
            self._file.close()
            raise ConfigError("data", self._folder, "used by another voltwall: stop it, or choose --data") from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Release."""
        if self._file is not None:
            self._file.close()
