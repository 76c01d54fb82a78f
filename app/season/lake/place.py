"""The place of a lake: a folder, or whatever else fsspec reaches by URL."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from filelock import FileLock

from app.errors import ConfigError, ExtraMissing
from app.words import Message


class LakeFolder:
    """A folder by path or URL. Files are put into it whole: a reader meets the old one or the new one."""

    def __init__(self, url: str | Path) -> None:
        """Name the place; nothing is made yet.

        Raises:
            ExtraMissing: fsspec, or what it needs for this kind of URL, is not installed.
            ConfigError: no such kind of URL, or a file.
        """
        try:
            from fsspec.core import url_to_fs
        except ImportError as error:
            raise ExtraMissing(Message("the-season-lake"), "fsspec", "season") from error
        self.url = str(url)
        try:
            fs, root = url_to_fs(self.url)
        except ImportError as error:
            raise ConfigError("lake", self.url, str(error)) from error
        except ValueError as error:
            raise ConfigError("lake", self.url, Message("a-folder-or-url")) from error
        self.fs: Any = fs
        self.is_local: bool = "file" in ([fs.protocol] if isinstance(fs.protocol, str) else fs.protocol)
        self.root: str = str(root).rstrip("/") or "/"
        if (
            self.is_local
            and not next(folder for folder in (Path(self.root), *Path(self.root).parents) if folder.exists()).is_dir()
        ):
            raise ConfigError("lake", self.url, Message("a-folder-or-url"))

    def make(self) -> None:
        """Make a local folder that is not there yet; a place by URL is made with its first file.

        Raises:
            ConfigError: it cannot be made, or not written into.
        """
        if not self.is_local:
            return
        try:
            Path(self.root).mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=self.root).close()
        except OSError as error:
            limit = Message("a-folder-to-write", error=error.strerror or str(error))
            raise ConfigError("lake", self.url, limit) from error

    def check_there(self) -> None:
        """Refuse a local folder that is not there.

        Raises:
            ConfigError: there is none.
        """
        if self.is_local and not Path(self.root).is_dir():
            raise ConfigError("lake", self.url, Message("no-lake-there"))

    def path(self, name: str) -> str:
        """Return the path of a file in the place, as its file system names it."""
        return f"{self.root}/{name}"

    def find(self, pattern: str) -> list[str]:
        """Return the paths of files that a pattern with `*` matches, in order."""
        return sorted(str(path) for path in self.fs.glob(self.path(pattern)))

    def put(self, name: str, write: Callable[[Path], None]) -> None:
        """Let `write` make a file, flush it to the disk, then put it where the old one is.

        On a local disk that is a rename, elsewhere one upload: whoever reads meanwhile, and whoever looks after a power
        cut, finds the old file or the new one. What was left unfinished begins with a dot and is never read.

        Raises:
            OSError: the place does not take it.
        """
        target = Path(self.path(name))
        if self.is_local:
            target.parent.mkdir(parents=True, exist_ok=True)
        handle, scratch_name = tempfile.mkstemp(prefix=f".{target.name}-", dir=target.parent if self.is_local else None)
        os.close(handle)
        scratch = Path(scratch_name)
        try:
            write(scratch)
            if self.is_local:
                _flush(scratch)
                scratch.chmod(0o644)
                scratch.replace(target)
                _flush(target.parent)
            else:
                self.fs.makedirs(self.path(name).rpartition("/")[0], exist_ok=True)
                self.fs.put_file(str(scratch), self.path(name))
        finally:
            scratch.unlink(missing_ok=True)

    @contextlib.contextmanager
    def one_writer(self) -> Iterator[None]:
        """Wait until nobody else writes into a local folder, and remove what power cuts left there unfinished."""
        if not self.is_local:
            yield
            return
        folder = Path(self.root)
        folder.mkdir(parents=True, exist_ok=True)
        with FileLock(folder / ".lock"):
            for left in folder.glob("car=*/season=*/session=*/.*.parquet-*"):
                left.unlink(missing_ok=True)
            yield


def _flush(path: Path) -> None:
    if os.name != "posix" and path.is_dir():
        return  # there a folder cannot be flushed
    handle = os.open(path, os.O_RDONLY if os.name == "posix" else os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
