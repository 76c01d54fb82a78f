"""The signed log: what changed a car or who may come in, in a file that only grows: who, when, what, why, result.

Writes of the configuration hold what was in force before and after; commands, frames sent onto a bus, accounts, tokens
and log-ins only their words.

The intent comes first: a line with the result "begun", on the disk before the master is asked for anything, then one
of the same number with the outcome, perhaps after those of others. Where the disk takes no intent, nothing is written.
An intent without an outcome is shown as what it is.

A record is one line of JSON with a signature: HMAC-SHA256, by a key in a file next to it that only its owner
may read, over the record and the signature before it. So a record that was changed, or one taken out of the middle,
shows when the file is read. It proves nothing against whoever can read the key, and it does not show that the last
records were cut off; the event log names the same writes. Several processes may write: `voltwall accounts` does next to
a running service.
"""

import base64
import hashlib
import hmac
import json
import os
import secrets
import threading
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, get_args

from filelock import FileLock

from app.sources.data_file import checked, flush_folder, parse_object, replace_file


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


ConfigAction = Literal["write", "load", "store", "rollback"]
OtherAction = Literal["command", "transmit", "setup", "access", "login"]
Action = ConfigAction | OtherAction
CONFIG_ACTIONS: tuple[str, ...] = get_args(ConfigAction)
ABOUT_PEOPLE = ("access", "login")
KEY_BYTES = 32
BEGUN = "begun"  # the result of an intent
_LOCK_S = 10.0


@dataclass(frozen=True, slots=True)
class Record:
    """One change; `number` counts from 1. `is_genuine` is False where its signature, or one before it, is not right."""

    number: int
    t_wall_ns: int
    who: str
    action: Action
    source: str  # where the new values came from: "draft", "profile wet-race@3"; or what was done: "charge-start"
    reason: str
    before: bytes
    after: bytes
    result: str  # "done", or what went wrong and what is in force
    is_genuine: bool = True


class ConfigHistory:
    """The file and its key; thread-safe."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / "config-history.jsonl"
        self._file = JsonLines(self._path)
        self._key_path = folder / "config-history.key"
        self._lock_file = folder / "config-history.lock"
        self._lock = threading.Lock()
        self._end: _End | None = None  # as this process left it

    def append(
        self,
        t_wall_ns: int,
        who: str,
        action: Action,
        source: str,
        reason: str,
        before: bytes,
        after: bytes,
        result: str,
        number: int | None = None,
    ) -> int:
        """Sign and keep a record; return its number. It is on the disk when this returns.

        With `number` it is the outcome of the intent that has this number.

        Raises:
            OSError: it cannot be kept.
        """
        with self._lock, FileLock(self._lock_file, timeout=_LOCK_S):
            end, self._end = self._read_end(), None
            number = number or end.number + 1
            body = {
                "number": number,
                "t_wall_ns": t_wall_ns,
                "who": who,
                "action": action,
                "source": source,
                "reason": reason,
                "before": base64.b64encode(before).decode(),
                "after": base64.b64encode(after).decode(),
                "result": result,
            }
            signature = _signature(self._key(), body, end.signature)
            self._file.append(body | {"signature": signature}, after=end.last)
            self._end = _End(self._path.stat().st_size, max(number, end.number), signature, [b"\n"])
            return number

    def records(self) -> list[Record]:
        """Return all records, oldest first; lines that are none are left out and make the next one not genuine."""
        records: list[Record] = []
        intents: dict[int, int] = {}  # number: place
        for record in self._read():  # without the lock, under which a record may wait for the disk
            if (place := intents.pop(record.number, None)) is not None:
                records[place] = replace(record, is_genuine=record.is_genuine and records[place].is_genuine)
                continue
            if record.result == BEGUN:
                intents[record.number] = len(records)
            records.append(record)
        return records

    def record(self, number: int) -> Record | None:
        """Return one record, None where there is none."""
        return next((record for record in self.records() if record.number == number), None)

    def _read_end(self) -> "_End":
        """What the next record comes after: as it was left, unless somebody else wrote meanwhile."""
        if self._end is None or not self._path.exists() or self._path.stat().st_size != self._end.size:
            lines = self._file.lines()
            return _End(0, _last_number(lines), _signature_of(lines[-1]) if lines else "", lines[-1:])
        return self._end

    def _read(self) -> Iterator[Record]:
        lines = self._file.lines()
        key, last = (self._key() if lines else b""), ""
        for line in lines:
            record = _parse(line)
            if record is None:
                last = _signature_of(line)
                continue
            body, signature = record
            genuine = hmac.compare_digest(_signature(key, body, last), signature)
            last = signature
            yield _record(body, is_genuine=genuine)

    def _key(self) -> bytes:
        """The key, made where there is none; an empty file is what a full disk left of an earlier version's."""
        if not self._key_path.exists() or not self._key_path.stat().st_size:
            replace_file(self._key_path, secrets.token_bytes(KEY_BYTES), is_private=True)
        return self._key_path.read_bytes()


@dataclass(frozen=True, slots=True)
class _End:
    """Of the file: its size, the highest number, the last signature, the last line if there is one."""

    size: int
    number: int
    signature: str
    last: list[bytes]


def _last_number(lines: list[bytes]) -> int:
    """The highest number; lines at the end that are no records count as one each."""
    numbers, unread = [0], 0
    for line in lines:
        parsed = _parse(line)
        unread = unread + 1 if parsed is None else 0
        numbers += [] if parsed is None else [int(parsed[0]["number"])]
    return max(numbers) + unread


def _signature(key: bytes, body: dict[str, Any], before: str) -> str:
    text = json.dumps(body, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hmac.new(key, f"{before}\n{text}".encode(errors="surrogatepass"), hashlib.sha256).hexdigest()


def _parse(line: bytes) -> tuple[dict[str, Any], str] | None:
    try:
        body = parse_object(line)
        signature = body.pop("signature")
        _record(body, is_genuine=False)
    except (ValueError, KeyError, TypeError):
        return None
    return body, str(signature)


def _signature_of(line: bytes) -> str:
    parsed = _parse(line)
    return parsed[1] if parsed else ""


def _record(body: dict[str, Any], *, is_genuine: bool) -> Record:
    """A record of its line.

    Raises:
        KeyError, TypeError, ValueError: it is none.
    """
    record = Record(
        body["number"],
        body["t_wall_ns"],
        body["who"],
        body["action"],
        body["source"],
        body["reason"],
        base64.b64decode(body["before"], validate=True),
        base64.b64decode(body["after"], validate=True),
        body["result"],
        is_genuine,
    )
    return checked(record)
