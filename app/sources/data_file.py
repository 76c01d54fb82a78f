"""Files of the data folder: JSON within bounds, a damaged one set aside, a new one put in its place as a whole."""

import contextlib
import logging
import os
from dataclasses import is_dataclass
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from types import UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import orjson

from app.clock import Clock

MOST_DEPTH = 32
LOGS = ("-wal", "-shm")  # suffixes of an SQLite file's logs
T = TypeVar("T")
log = logging.getLogger(__name__)


def parse_json(text: str | bytes, *, most_bytes: int = 16 << 20, most_depth: int = MOST_DEPTH) -> Any:
    """Return the value of a JSON text whose nesting, size and numbers are bounded; its strings can be encoded.

    Raises:
        ValueError: it is none, is nested deeper than `most_depth`, or has more than `most_bytes`.
    """
    if len(text) > most_bytes:
        raise ValueError(f"more than {most_bytes} bytes")
    value = orjson.loads(text)  # at most 1,024 deep, only finite numbers and whole surrogate pairs
    _require_depth(value, most_depth)
    return value


def parse_object(text: str | bytes, *, most_bytes: int = 16 << 20, most_depth: int = MOST_DEPTH) -> dict[str, Any]:
    """Return the object of a JSON text, as `parse_json`.

    Raises:
        ValueError: also where it is another value.
    """
    value = parse_json(text, most_bytes=most_bytes, most_depth=most_depth)
    if not isinstance(value, dict):
        raise ValueError("no JSON object")  # noqa: TRY004  as all else that is wrong with it
    return value


def checked(value: T) -> T:
    """Return a dataclass that was made of JSON, if every field is of its declared type; whole numbers fit 64 bits.

    Raises:
        TypeError: names a field that is not.
    """
    kind: type = type(value)
    for name, hint in _hints(kind).items():
        if not _fits(getattr(value, name), hint):
            raise TypeError(name)
    return value


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def _fits(value: object, hint: Any) -> bool:
    origin, args = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        return any(_fits(value, arg) for arg in args)
    if origin is Literal:
        return value in args
    if origin is tuple:
        return isinstance(value, tuple) and all(_fits(element, args[0]) for element in value)
    if hint in (int, float):
        is_number = isinstance(value, hint | int) and not isinstance(value, bool)
        return is_number and (isinstance(value, float) or -(1 << 63) <= value < 1 << 63)  # type: ignore[operator]
    if is_dataclass(hint) and type(value) is hint:
        return checked(value) is value
    return isinstance(value, origin or hint)


def encodable(name: str) -> str:
    """Return a file's name as text that can be sent: bytes that are no UTF-8 become question marks."""
    return name.encode(errors="replace").decode()


def set_aside(path: Path, clock: Clock | None = None) -> Path:
    """Rename a damaged file, with its SQLite log, to a name with the time in it; return where it is now.

    Raises:
        OSError: it cannot be renamed.
    """
    now = datetime.fromtimestamp((clock or Clock()).wall_s(), UTC)
    stem = f"{path.name}.damaged-{now:%Y%m%dT%H%M%SZ}"
    number, target = 1, path.with_name(stem)
    while target.exists():
        number += 1
        target = path.with_name(f"{stem}-{number}")
    path.rename(target)
    for end in LOGS:
        rest = path.with_name(path.name + end)
        if rest.exists():
            rest.rename(target.with_name(target.name + end))
    log.warning("%s is damaged; it is now %s", path, target.name)
    return target


def _require_depth(value: object, left: int) -> None:
    if isinstance(value, dict | list):
        if left == 0:
            raise ValueError("nested too deep")
        for element in value.values() if isinstance(value, dict) else value:
            _require_depth(element, left - 1)


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
        draft.unlink(missing_ok=True)  # left by a crash: it may have been readable by all
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
