"""Every write of the configuration, in a file that only grows: who, when, from, to, why, with what result.

The intent comes first: a line with the result "begun", on the disk before the master is asked for anything, then one
of the same number with the outcome. Where the disk takes no intent, nothing is written. An intent without an outcome is
shown as what it is.

A record is one line of JSON with a signature: HMAC-SHA256, by a key that lies beside the file and that only its owner
may read, over the record and the signature before it. So a record that was changed, or one taken out of the middle,
shows when the file is read. It proves nothing against whoever can read the key, and it does not show that the last
records were cut off; the event log names the same writes.
"""

import base64
import hashlib
import hmac
import json
import secrets
import threading
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from app.configuration.json_lines import JsonLines
from app.sources.whole_file import replace_file

Action = Literal["write", "load", "store", "rollback"]
KEY_BYTES = 32
BEGUN = "begun"  # the result of an intent


@dataclass(frozen=True, slots=True)
class Record:
    """One write; `number` counts from 1. `is_genuine` is False where its signature, or one before it, is not right."""

    number: int
    t_wall_ns: int
    who: str
    action: Action
    source: str  # where the new values came from: "draft", "profile wet-race@3", "record 7"
    reason: str
    before: bytes
    after: bytes
    result: str  # "done", or what went wrong and what is in force
    is_genuine: bool = True


class ConfigHistory:
    """The file and its key; thread-safe."""

    def __init__(self, folder: Path) -> None:
        self._file = JsonLines(folder / "config-history.jsonl")
        self._key_path = folder / "config-history.key"
        self._lock = threading.Lock()

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
        with self._lock:
            lines = self._file.lines()
            number = number or _next_number(lines)
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
            signature = _signature(self._key(), body, _signature_of(lines[-1]) if lines else "")
            self._file.append(body | {"signature": signature}, after=lines)
            return number

    def records(self) -> list[Record]:
        """Return all records, oldest first; lines that are none are left out and make the next one not genuine."""
        found: list[Record] = []
        with self._lock:
            for record in self._read():
                intent = found[-1] if found else None
                if intent is not None and intent.number == record.number and intent.result == BEGUN:
                    found[-1] = replace(record, is_genuine=record.is_genuine and intent.is_genuine)
                else:
                    found.append(record)
        return found

    def record(self, number: int) -> Record | None:
        """Return one record, None where there is none."""
        return next((record for record in self.records() if record.number == number), None)

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


def _next_number(lines: list[bytes]) -> int:
    """The number after the last record; a line that is none counts as one."""
    for unread, line in enumerate(reversed(lines)):
        if (parsed := _parse(line)) is not None:
            return int(parsed[0]["number"]) + unread + 1
    return len(lines) + 1


def _signature(key: bytes, body: dict[str, Any], before: str) -> str:
    text = json.dumps(body, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hmac.new(key, f"{before}\n{text}".encode(errors="surrogatepass"), hashlib.sha256).hexdigest()


def _parse(line: bytes) -> tuple[dict[str, Any], str] | None:
    try:
        body = json.loads(line)
        signature = body.pop("signature")
        _record(body, is_genuine=False)
    except (ValueError, KeyError, TypeError, AttributeError):
        return None
    return body, str(signature)


def _signature_of(line: bytes) -> str:
    parsed = _parse(line)
    return parsed[1] if parsed else ""


def _record(body: dict[str, Any], *, is_genuine: bool) -> Record:
    return Record(
        int(body["number"]),
        int(body["t_wall_ns"]),
        str(body["who"]),
        body["action"],
        str(body["source"]),
        str(body["reason"]),
        base64.b64decode(body["before"], validate=True),
        base64.b64decode(body["after"], validate=True),
        str(body["result"]),
        is_genuine,
    )
