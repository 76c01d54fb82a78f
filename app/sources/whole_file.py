"""Replacing a file as a whole: a fault of the disk, or a power cut, leaves the old one or the new one."""

import contextlib
import os
from pathlib import Path


def replace_file(path: Path, content: bytes, *, is_private: bool = False) -> None:
    """Make a file of this content, or put it where the old one is; it is on the disk when this returns.

    Args:
        path: in a folder that exists.
        content: all of it.
        is_private: only its owner may read it.

    Raises:
        OSError: the disk does not take it; the error names the file.
    """
    draft = path.with_name(f".{path.name}.new")
    try:
        draft.unlink(missing_ok=True)  # of a crash: it may have been readable by all
        handle = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600 if is_private else 0o666)
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        draft.replace(path)
    except OSError as error:
        with contextlib.suppress(OSError):
            draft.unlink(missing_ok=True)
        raise OSError(error.errno, error.strerror, str(path)) from error
    flush_folder(path.parent)


def flush_folder(folder: Path) -> None:
    """Bring what files a folder has to the disk; on Windows this cannot be asked for."""
    if os.name != "posix":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
