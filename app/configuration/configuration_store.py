"""The profiles of a data folder: `profiles/NAME.json` is the newest, `profiles/versions/NAME@3.json` all of them."""

import re
import threading
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

from app.clock import Clock
from app.configuration.saved_configuration import SavedConfiguration, parse_profile, profile_text
from app.errors import AppError, ConfigError
from app.sources.data_file import replace_file
from app.words import Message

_NAME = re.compile(r"[a-z0-9][a-z0-9._-]{0,39}")
_RESERVED = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?")  # no file of Windows may be called so


class NoSavedConfiguration(AppError):
    """There is no such profile, or not this version of it."""


class ConfigurationStore:
    """Saves and loads; thread-safe."""

    def __init__(self, folder: Path, clock: Clock) -> None:
        self._clock = clock
        self._folder = folder
        self._versions = folder / "versions"
        self._lock = threading.Lock()

    def names(self) -> list[str]:
        """The names, in order."""
        return sorted(path.stem for path in self._folder.glob("*.json") if _NAME.fullmatch(path.stem))

    def versions(self, name: str) -> list[int]:
        """The versions of a name, newest first."""
        pattern = re.compile(re.escape(_checked(name)) + r"@(\d+)\.json")
        matches = (pattern.fullmatch(path.name) for path in self._versions.glob("*.json"))
        return sorted((int(match[1]) for match in matches if match), reverse=True)

    def load(self, name: str, version: int | None = None) -> SavedConfiguration:
        """Return a profile, without a version the newest.

        Raises:
            NoProfile: there is none.
            ConfigError: its file was changed into something else, or cannot be read.
        """
        path = self._folder / f"{_checked(name)}.json"
        if version is not None:
            path = self._versions / f"{name}@{version}.json"
        try:
            return parse_profile(path.read_bytes())
        except FileNotFoundError as error:
            if version is None:
                raise NoSavedConfiguration(Message("no-profile", profile=name)) from error
            raise NoSavedConfiguration(Message("no-profile-version", profile=name, version=version)) from error
        except OSError as error:
            raise ConfigError("profile", name, Message("cannot-be-read", error=error.strerror or str(error))) from error

    def save(
        self, name: str, image: bytes, *, comment: str, who: str, converted_from: str | None = None
    ) -> SavedConfiguration:
        """Keep an image as the next version of a name; `converted_from` is the memory map that it was of.

        Raises:
            ConfigError: the name cannot be a file's.
            OSError: the disk does not take it; all is as before.
        """
        with self._lock:
            version = 1 + max([0, *self.versions(name), self._current(name)])
            now = datetime.fromtimestamp(self._clock.wall_s(), UTC).isoformat(timespec="seconds")
            profile = SavedConfiguration(
                _checked(name), version, comment.strip()[:500], who, now, image, converted_from
            )
            text = profile_text(profile)
            self._versions.mkdir(parents=True, exist_ok=True)
            kept = self._versions / f"{name}@{version}.json"
            replace_file(kept, text.encode())
            try:
                replace_file(self._folder / f"{name}.json", text.encode())
            except OSError:
                with suppress(OSError):
                    kept.unlink()
                raise
            return profile

    def _current(self, name: str) -> int:
        """The version of the newest file, which may have come by git without the earlier ones."""
        try:
            return self.load(name).version
        except NoSavedConfiguration:
            return 0
        except ConfigError as error:
            if isinstance(error.__cause__, OSError):  # it is there, and its number is not known
                raise
            return 0

    def delete(self, name: str) -> None:
        """Remove a profile; its versions stay, and a later one counts on from them.

        Raises:
            NoProfile: there is none.
        """
        with self._lock:
            try:
                (self._folder / f"{_checked(name)}.json").unlink()
            except FileNotFoundError as error:
                raise NoSavedConfiguration(Message("no-profile", profile=name)) from error


def _checked(name: str) -> str:
    if not _NAME.fullmatch(name) or _RESERVED.fullmatch(name):
        raise ConfigError("name", name[:60], Message("profile-name"))
    return name
