"""The history of writes: what was written is read back, and what was changed afterwards shows."""

import json

import pytest

from app.configuration.history import BEGUN, ConfigHistory
from firmware_protocol.config_image import default_image, with_raw

OLD = default_image()
NEW = with_raw(OLD, "t_cell_max", 50)


@pytest.fixture
def history(tmp_path):
    return ConfigHistory(tmp_path)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "config-history.jsonl"


def add(history, who="ada", result="done"):
    return history.append(1_700_000_000_000_000_000, who, "write", "draft", "wet race", OLD, NEW, result)


def lines(path):
    return path.read_text().splitlines(keepends=True)


def test_a_record_is_read_back_as_it_was_written_also_by_the_next_run(history, tmp_path):
    assert [add(history), add(history, "bob")] == [1, 2]
    first, second = ConfigHistory(tmp_path).records()
    assert (first.number, first.who, first.before, first.after, first.reason) == (1, "ada", OLD, NEW, "wet race")
    assert (second.who, second.is_genuine, first.is_genuine) == ("bob", True, True)
    assert history.record(2) == second
    assert history.record(3) is None


def test_a_changed_record_is_not_genuine(history, path):
    for who in ("ada", "bob", "cleo"):
        add(history, who)
    before = lines(path)
    path.write_text(before[0] + before[1].replace("bob", "eve") + before[2])
    assert [r.is_genuine for r in history.records()] == [True, False, True]


def test_a_record_taken_out_of_the_middle_shows(history, path):
    for who in ("ada", "bob", "cleo"):
        add(history, who)
    before = lines(path)
    path.write_text(before[0] + before[2])
    assert [r.is_genuine for r in history.records()] == [True, False]


def test_another_key_makes_nothing_genuine(history, tmp_path):
    add(history)
    (tmp_path / "config-history.key").write_bytes(b"another")
    assert [r.is_genuine for r in history.records()] == [False]


def test_only_the_owner_may_read_the_key(history, tmp_path):
    add(history)
    assert (tmp_path / "config-history.key").stat().st_mode & 0o077 == 0


@pytest.mark.parametrize("kept", [1, 40, -2, -1])
def test_a_record_cut_by_a_power_failure_spoils_no_other(history, path, kept):
    add(history)
    whole = path.read_bytes()
    add(history, "bob")
    path.write_bytes(path.read_bytes()[: len(whole) + kept] if kept > 0 else path.read_bytes()[:kept])
    add(history, "cleo")
    records = history.records()
    assert [r.who for r in records if r.who != "bob"] == ["ada", "cleo"]
    assert [r.number for r in records if r.who == "cleo"] == [3]
    assert records[0].is_genuine


@pytest.mark.parametrize("line", [b"{}", b"[1]", b"null", b'"x"', b"\xff\xfe", b'{"signature": 1}', b""])
def test_lines_that_are_no_records_are_left_out(history, path, line):
    add(history)
    with path.open("ab") as file:
        file.write(line + b"\n")
    assert [r.number for r in history.records()] == [1]


def test_a_record_is_json_for_other_programs(history, path):
    add(history)
    record = json.loads(lines(path)[0])
    assert (record["who"], record["reason"], len(record["signature"])) == ("ada", "wet race", 64)


def test_a_key_that_a_full_disk_left_empty_signs_nothing(history, path):
    (path.parent / "config-history.key").touch()
    add(history)
    assert (path.parent / "config-history.key").stat().st_size == 32
    assert history.records()[0].is_genuine


def test_outcomes_find_their_intents_also_after_those_of_others(history, tmp_path):
    beside = ConfigHistory(tmp_path)  # as another process has it
    first, second = add(history, "ada", BEGUN), add(beside, "bob", BEGUN)

    def end(log, number, who):
        log.append(0, who, "command", "reset", "", b"", b"", "done", number)

    end(beside, second, "bob")
    assert [(r.who, r.result) for r in history.records()] == [("ada", BEGUN), ("bob", "done")]
    end(history, first, "ada")
    assert add(beside, "cleo") == 3
    assert [(r.number, r.who, r.result, r.is_genuine) for r in history.records()] == [
        (1, "ada", "done", True),
        (2, "bob", "done", True),
        (3, "cleo", "done", True),
    ]
