"""Session files as an attacker, or a broken disk, leaves them: each hurts one reader, and must hurt no other file."""

import json
import shutil
import sqlite3
from collections.abc import Callable
from pathlib import Path

DEEP = 100_000
DEEP_LIST = "[" * DEEP + "]" * DEEP
DEEP_TOML = "name = " + "[" * DEEP + "]" * DEEP


def _meta(key: str, value: object) -> Callable[[sqlite3.Connection], object]:
    return lambda file: file.execute("UPDATE meta SET value = ? WHERE key = ?", (value, key))


def _note(key: str, value: object) -> Callable[[sqlite3.Connection], object]:
    return lambda file: file.execute("INSERT OR REPLACE INTO notes VALUES (?, ?, 0, NULL)", (key, value))


def _battery(data: object) -> Callable[[sqlite3.Connection], object]:
    def change(file: sqlite3.Connection) -> None:
        file.execute("DELETE FROM battery_files")
        file.execute("INSERT INTO battery_files (name, data) VALUES ('battery.toml', ?)", (data,))

    return change


UNREADABLE = {
    "deep": _meta("metadata", '{"a":' * DEEP + "1" + "}" * DEEP),
    "33 deep": _meta("metadata", '{"a":' * 33 + "1" + "}" * 33),
    "a number": _meta("metadata", "1"),
    "no JSON": _meta("metadata", "{"),
    "half a surrogate pair": _meta("metadata", '{"driver": "\\ud800"}'),
    "not a number": _meta("metadata", '{"driver": NaN}'),
    "infinite": _meta("metadata", '{"driver": 1e999}'),
    "a blob": _meta("metadata", b"{}"),
    "16 MB": _meta("metadata", json.dumps({"driver": "x" * (16 << 20)})),
    "name a blob": _meta("name", b"\xff"),
    "name of a megabyte": _meta("name", "x" * (1 << 20)),
    "version a blob": _meta("voltwall", b"1"),
    "start no number": _meta("start_mono_ns", "soon"),
    "start beyond 64 bits": _meta("start_mono_ns", str(1 << 63)),
    "start of many digits": _meta("start_mono_ns", "9" * 60_000),
    "end a blob": _meta("end_mono_ns", b"\x00"),
    "clock beyond 64 bits": lambda file: file.execute(
        "UPDATE clock SET t_wall_ns = 9223372036854775807, t_mono_ns = -9"
    ),
    "clock a text": lambda file: file.execute("UPDATE clock SET t_wall_ns = 'x' || char(0), t_mono_ns = 1e300"),
    "tags deep": _note("tags", DEEP_LIST),
    "tags no JSON": _note("tags", "{"),
    "tags a blob": _note("tags", b"\xff\xfe"),
}
BATTERIES = {
    "battery deep": _battery(DEEP_TOML.encode()),
    "battery no TOML": _battery(b"\xff\x00"),
    "battery a number": _battery(1),
    "battery of 33 MB": _battery(b"#" * (33 << 20)),
}
HARMLESS = {
    "name a number": _meta("name", 1),
    "tags a number": _note("tags", "1"),
    "filled no spans": _meta("metadata", '{"filled": [[1], "x", null]}'),
    "an empty name": _meta("name", ""),
}


def hostile(sound: Path, target: Path, change: Callable[[sqlite3.Connection], object]) -> Path:
    """Return a copy of a closed session that was changed."""
    shutil.copy(sound, target)
    file = sqlite3.connect(target)
    with file:
        change(file)
    file.execute("PRAGMA journal_mode = DELETE")
    file.close()
    return target
