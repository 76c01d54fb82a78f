"""A file that only grows, one line a record; a line that was cut while it was written spoils no other."""

import json
import os
from pathlib import Path
from typing import Any

from app.sources.whole_file import flush_folder


class JsonLines:
    """The file; whoever owns it holds the lock."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def lines(self) -> list[bytes]:
        """Return every line with its end; the last one may have none. Empty where there is no file."""
        return self._path.read_bytes().splitlines(keepends=True) if self._path.exists() else []

    def append(self, record: dict[str, Any], *, after: list[bytes]) -> None:
        """Add a record after the lines that were read; it is on the disk when this returns.

        Raises:
            OSError: it cannot be kept; the error names the file.
        """
        is_cut = bool(after) and not after[-1].endswith(b"\n")
        line = json.dumps(record, ensure_ascii=False).encode() + b"\n"
        try:
            with self._path.open("ab") as file:
                file.write((b"\n" if is_cut else b"") + line)
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self._path)) from error
        if not after:
            flush_folder(self._path.parent)
