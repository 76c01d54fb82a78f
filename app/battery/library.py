"""The library of profiles: bundled ones by name, files by path, and the files that they include."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path
from typing import Any

from app.battery.by_shape import files_of_shape
from app.battery.profile import WITHDRAWN, BatteryProfile, Document, read_document, refuse_withdrawn, understand
from app.battery.table_reader import ProfileError
from app.errors import unknown_name
from app.words import Message

_DEEPEST = 8  # profiles that include each other


def bundled_profiles() -> tuple[str, ...]:
    """Return the names of the profiles that come with the program."""
    return tuple(sorted(file.name.removesuffix(".toml") for file in _folder().iterdir() if file.name.endswith(".toml")))


def _folder() -> Path:
    return Path(str(resources.files(__package__) / "bundled"))


@dataclass(frozen=True, slots=True)
class LoadedProfile:
    """A profile with its text and the files that it names."""

    profile: BatteryProfile
    text: str
    dbc_files: tuple[Path, ...]


def load_profile(name: str) -> LoadedProfile:
    """Return a bundled profile by its name, or one of a file.

    Raises:
        ProfileError: it cannot be read, or is wrong; the error names line and field.
    """
    text, folder, file = _read(name, Path(), None)
    document = _document(text, file, folder, 0)
    profile = understand(document)
    dbc = getattr(profile.source, "dbc", ())
    return LoadedProfile(profile, text, tuple(Path(file) for file in dbc))


def file_name_of(battery: str) -> str:
    """Return a battery's name as part of a file's name."""
    return re.sub(r"[^a-z0-9]+", "-", battery.lower()).strip("-") or "battery"


def profile_files(name: str, *, own_folder: bool = False) -> dict[str, bytes]:
    """Return a profile, what it includes and its DBCs, each by the name under which it is named; its own comes first.

    A name like `2x6` is a battery of that shape, whose files are made.

    Args:
        name: of a bundled profile, or the path of a file.
        own_folder: it comes from a request: it may name files of its own folder, and bundled ones, alone.

    Raises:
        ProfileError: one cannot be read, two files have the same name, or one is not of its own folder.
    """
    by_shape = files_of_shape(name)
    if by_shape is not None:
        return by_shape
    files: dict[str, bytes] = {}

    def keep(file: str, key: str, data: bytes) -> None:
        if files.setdefault(key, data) != data:
            raise ProfileError(file, None, "include", key, Message("two-files-of-a-name"))

    def collect(name: str, folder: Path, included_by: str | None, depth: int) -> None:
        if depth >= _DEEPEST:
            raise ProfileError(included_by or name, None, "include", name, Message("includes-itself"))
        text, inner, file = _read(name, folder, included_by)
        keep(included_by or file, name if included_by else file, text.encode())
        document = read_document(text, file, lambda _: Document("", {}, {}))
        refuse_withdrawn(document)
        values = document.values
        dbcs = dict.fromkeys(_texts(values.get("source"), "dbc"))
        cell = values.get("battery", {}).get("cell", "") if isinstance(values.get("battery"), dict) else ""
        for named in (*dbcs, *_texts(values, "include"), str(cell)):
            if own_folder and Path(named).name != named:
                raise ProfileError(file, None, "battery", named, Message("battery-own-folder"))
        for dbc in dbcs:
            try:
                keep(file, dbc, _found(inner, dbc).read_bytes())
            except OSError as error:
                raise ProfileError(file, None, "source.dbc", dbc, error.strerror or str(error)) from error
        for include in _texts(values, "include"):
            collect(include, inner, file, depth + 1)

    collect(name, Path(), None, 0)
    return files


def profile_of(files: Mapping[str, bytes]) -> BatteryProfile:
    """Return the profile of such files; it names its DBCs as they are named there.

    Raises:
        ProfileError: it is wrong; the error names line and field.
    """

    def document(name: str, depth: int) -> Document:
        if depth >= _DEEPEST:
            raise ProfileError(own, None, "include", name, Message("includes-itself"))
        if name not in files:
            raise ProfileError(own, None, "include", name, Message("no-such-file"))
        return read_document(files[name].decode("utf-8", "replace"), name, lambda inner: document(inner, depth + 1))

    own = next(iter(files))
    profile = document(own, 0)
    values = {
        name: value for name, value in profile.values.items() if name != WITHDRAWN
    }  # an old session's profile may have it
    return understand(replace(profile, values=values))


def _texts(table: Any, name: str) -> list[str]:
    given = table.get(name, []) if isinstance(table, Mapping) else []
    return [text for text in (given if isinstance(given, list) else [given]) if isinstance(text, str)]


def load_part(name: str) -> Document:
    """Return the tables of a profile as they stand, with what it includes; it need not be a whole battery, or right.

    Raises:
        ProfileError: it cannot be read.
    """
    text, folder, file = _read(name, Path(), None)
    return _document(text, file, folder, 0)


def _document(text: str, file: str, folder: Path, depth: int) -> Document:
    def include(name: str) -> Document:
        if depth >= _DEEPEST:
            raise ProfileError(file, None, "include", name, Message("includes-itself"))
        return _document(*_inner(name, folder, file), depth + 1)

    document = read_document(text, file, include)
    source = document.values.get("source")
    if isinstance(source, dict) and isinstance(source.get("dbc"), str | list):
        named = source["dbc"] if isinstance(source["dbc"], list) else [source["dbc"]]
        source["dbc"] = [str(_found(folder, name)) if isinstance(name, str) else name for name in named]
    return document


def _inner(name: str, folder: Path, file: str) -> tuple[str, str, Path]:
    text, inner_folder, inner_file = _read(name, folder, file)
    return text, inner_file, inner_folder


def _found(folder: Path, name: str) -> Path:
    """A file next to the profile, else a bundled one of this name."""
    own = folder / name
    return _folder() / name if not own.is_file() and (_folder() / name).is_file() else own


def _read(name: str, folder: Path, included_by: str | None) -> tuple[str, Path, str]:
    """Text, folder and name for errors."""
    path = folder / name
    if name in bundled_profiles() and not path.is_file():
        path = _folder() / f"{name}.toml"
    try:
        return path.read_text(encoding="utf-8-sig"), path.parent, path.name
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        field = "battery" if included_by is None else "include"
        if isinstance(error, FileNotFoundError):
            limit = unknown_name(name, bundled_profiles())
        else:
            limit = Message("profile-unreadable", error=reason or str(error), names=bundled_profiles())
        raise ProfileError(included_by or name, None, field, name, limit) from error
