"""Files of the data folder: replaced whole, bounded JSON, fields of their types, damaged ones set aside by name."""

import json
import math
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import pytest

from app.configuration.history import ConfigHistory
from app.configuration.slave_check import Cause, CheckedCell, SlaveCheckLog, SlaveVerdict
from app.season.estimates.results import _SET as SET
from app.season.estimates.results import SCHEMA, Results
from app.sessions.transfer.session_copy import SessionCopy
from app.sources.data_file import MOST_DEPTH, checked, parse_json, parse_object, replace_file, set_aside
from firmware_protocol.config_image import default_image
from tests.fake_clock import FakeClock

DEEP = "[" * 100_000


@pytest.mark.parametrize(
    "text",
    ["", "{", DEEP, "[" * 33 + "]" * 33, "NaN", "1e999", '"\\ud800"', b"\xff", '{"a": "' + "x" * 2000 + '"}'],
)
def test_json_that_nobody_should_hold_is_a_value_error(text):
    with pytest.raises(ValueError, match=r"bytes|deep|column"):
        parse_json(text, most_bytes=1 << 20 if text == DEEP else 1000)


@pytest.mark.parametrize("text", ["1", "[]", '"a"', "null"])
def test_another_value_is_no_object(text):
    with pytest.raises(ValueError, match="object"):
        parse_object(text)


def test_what_is_within_the_bounds_is_what_it_was():
    value = {"a": [1, 2.5, None, True, "Å"], "deep": json.loads("[" * (MOST_DEPTH - 1) + "]" * (MOST_DEPTH - 1))}
    assert parse_object(json.dumps(value)) == value


@dataclass(frozen=True)
class Part:
    name: str


@dataclass(frozen=True)
class Whole:
    number: int = 1
    share: float = 0.5
    kind: Literal["a", "b"] = "a"
    note: str | None = None
    parts: tuple[Part, ...] = ()
    about: Mapping[str, object] | None = None
    is_good: bool = False


@pytest.mark.parametrize(
    "given",
    [
        {},
        {"number": -(1 << 63)},
        {"share": 2},
        {"kind": "b", "note": "x"},
        {"parts": (Part("p"),)},
        {"about": {"a": []}},
    ],
)
def test_fields_of_their_types_pass(given):
    assert checked(Whole(**given)) == Whole(**given)


@pytest.mark.parametrize(
    "given",
    [
        {"number": 1 << 63}, {"number": 1.5}, {"number": True}, {"number": "1"}, {"share": None}, {"share": "x"},
        {"kind": "c"}, {"kind": []}, {"note": 1}, {"parts": [Part("p")]}, {"parts": ("p",)}, {"parts": (Part(1),)},
        {"about": []}, {"is_good": 1},
    ],
)  # fmt: skip
def test_fields_of_other_types_do_not(given):
    with pytest.raises(TypeError, match="name|" + next(iter(given))):
        checked(Whole(**given))


def test_two_files_set_aside_within_a_second_keep_their_names(tmp_path: Path):
    path, clock, kept = tmp_path / "events.sqlite", FakeClock(wall_s=1_790_000_000.0), []
    for content in ("one", "two", "three"):
        path.write_text(content)
        path.with_name("events.sqlite-wal").write_text(f"log of {content}")
        kept.append(set_aside(path, clock))
    assert [each.name for each in kept] == [f"events.sqlite.damaged-20260921T141320Z{end}" for end in ("", "-2", "-3")]
    assert [each.read_text() for each in kept] == ["one", "two", "three"]
    assert kept[1].with_name(kept[1].name + "-wal").read_text() == "log of two"
    assert not path.exists()


WRONG_LINES = (
    DEEP, '{"a":' * 100_000, "[]", "1", "{}", '{"number": "x"}', "\x00\xff",
)  # fmt: skip


def test_lines_of_the_signed_log_that_are_none_hide_no_other_and_end_no_write(tmp_path: Path):
    history, image = ConfigHistory(tmp_path), default_image()
    history.append(1, "ada", "write", "draft", "", image, image, "done")
    path = tmp_path / "config-history.jsonl"
    (line,) = path.read_text().splitlines()
    changes = {"number": [10**30, "1", None], "t_wall_ns": [10**400, 1.5], "who": [None, []], "action": ["x", {}]}
    forged = [json.dumps(json.loads(line) | {name: each}) for name, values in changes.items() for each in values]
    with path.open("a") as file:
        file.write("\n".join([*WRONG_LINES, *forged]) + "\n")
    again = ConfigHistory(tmp_path)
    again.append(2, "ada", "store", "", "", image, image, "done")
    found = again.records()
    assert [record.action for record in found] == ["write", "store"]
    assert all(math.isfinite(record.t_wall_ns / 1e9) for record in found)


def test_lines_of_the_slave_checks_that_are_none_hide_no_other(tmp_path: Path):
    log = SlaveCheckLog(tmp_path)
    verdict = SlaveVerdict((CheckedCell(0, 3.7, 0.001, 3.71, -0.01, False),), get_args(Cause)[0], (0,), None, 0.005)
    log.append(1, "ada", 0, "voltage", "Fluke", 0.0, "", verdict)
    path = tmp_path / "slave-checks.jsonl"
    (line,) = path.read_text().splitlines()
    forged = [json.dumps(json.loads(line) | change) for change in ({"who": 1}, {"t_wall_ns": 1e300}, {"quantity": "x"})]
    with path.open("a") as file:
        file.write("\n".join([*WRONG_LINES, *forged]) + "\n")
    assert [check.who for check in log.checks()] == ["ada"]
    log.append(2, "eva", 0, "voltage", "Fluke", 0.0, "", verdict)
    assert [check.who for check in log.checks()] == ["eva", "ada"]


def test_damaged_heads_of_copies_and_results_count_as_none(tmp_path: Path):
    head = tmp_path / ".copies" / "car-x" / "head.json"
    head.parent.mkdir(parents=True)
    head.write_text(DEEP)
    assert SessionCopy(tmp_path, "car-x").head == {}
    assert SessionCopy.all_in(tmp_path) == []
    results = Results(tmp_path)
    for k, content in enumerate((DEEP, "[]", '{"schema": 1, "cell": 7}', json.dumps({"schema": SCHEMA}))):
        folder = results.folder / f"set-{k}"
        folder.mkdir(parents=True)
        (folder / SET).write_text(content)
    assert results.sets() == []


def test_the_new_content_stands_where_the_old_one_did(tmp_path):
    path = tmp_path / "settings.json"
    for content in (b"old", b"new"):
        replace_file(path, content)
        assert path.read_bytes() == content
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_a_refused_file_leaves_the_old_one_and_nothing_beside_it(call, tmp_path, monkeypatch):
    path = tmp_path / "settings.json"
    replace_file(path, b"old")

    def refuse(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(*((os, call) if call == "fsync" else (Path, call)), refuse)
    with pytest.raises(OSError, match="No space"):
        replace_file(path, b"new")
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such mode")
def test_a_private_file_is_its_owners(tmp_path):
    replace_file(tmp_path / "key", b"secret", is_private=True)
    assert (tmp_path / "key").stat().st_mode & 0o077 == 0


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such mode")
def test_a_private_file_takes_neither_a_draft_nor_an_old_file_that_all_may_read(tmp_path):
    for name in ("key", ".key.new"):  # an earlier version's, and what a crash left
        (tmp_path / name).write_bytes(b"readable by all")
        (tmp_path / name).chmod(0o644)
    replace_file(tmp_path / "key", b"secret", is_private=True)
    assert (tmp_path / "key").read_bytes() == b"secret"
    assert (tmp_path / "key").stat().st_mode & 0o077 == 0
    assert [each.name for each in tmp_path.iterdir()] == ["key"]
