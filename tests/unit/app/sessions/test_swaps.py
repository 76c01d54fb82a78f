"""Swaps of modules in their file, and those of earlier versions, which are taken over once."""

import sqlite3
from contextlib import closing

import pytest

from app.errors import ConfigError
from app.sessions.swaps import Swap, SwapFile
from app.sources.loaded_battery import load_battery, team_battery

BATTERY = team_battery().battery
WHEN_S = 1_790_000_000.0


def old_file(path, *, version=2):
    """The file of cell passports of an earlier version, with two swaps."""
    with closing(sqlite3.connect(path)) as file, file:
        file.execute("PRAGMA journal_mode = WAL")
        file.execute("CREATE TABLE records (session_id TEXT PRIMARY KEY, start_wall_ns INTEGER, body BLOB)")
        file.execute("CREATE TABLE swaps (id INTEGER PRIMARY KEY, t_wall_ns INTEGER, cells TEXT, note TEXT, who TEXT)")
        rows = [(7, round((WHEN_S + 1) * 1e9), "[3, 4]", "spare", "ada"), (8, round(WHEN_S * 1e9), "[5]", "", None)]
        file.executemany("INSERT INTO swaps VALUES (?, ?, ?, ?, ?)", rows)
        if version == 2:
            file.execute("ALTER TABLE swaps ADD COLUMN car TEXT")
            file.execute("UPDATE swaps SET car = 'red' WHERE id = 7")
        file.execute(f"PRAGMA user_version = {version}")


def test_swaps_are_kept_in_order_and_taken_back(tmp_path):
    swaps = SwapFile(tmp_path, BATTERY)
    assert swaps.read() == []
    swaps.add([4, 3, 4], WHEN_S, "spare", "ada", "red", ["blue", "red"])
    SwapFile(tmp_path, BATTERY).add([5], WHEN_S - 1, "", None, "", [])
    assert swaps.read() == [Swap(WHEN_S - 1, (5,), id=2), Swap(WHEN_S, (3, 4), "spare", "ada", "red", 1)]
    assert swaps.remove(1)
    assert not swaps.remove(1)
    assert [each.id for each in swaps.read()] == [2]


def test_a_swap_without_a_car_is_of_the_only_one_and_of_every_one_before_there_is_any(tmp_path):
    swaps = SwapFile(tmp_path, BATTERY)
    swaps.add([3], WHEN_S, "", None, "", [])
    swaps.add([4], WHEN_S, "", None, "", ["red"])
    assert [each.car for each in swaps.read()] == [None, "red"]
    assert [each.is_of("blue") for each in swaps.read()] == [True, False]


@pytest.mark.parametrize(("car", "cars"), [("", ["blue", "red"]), ("green", ["blue", "red"]), ("green", ["red"])])
def test_which_of_several_cars_has_to_be_said(tmp_path, car, cars):
    with pytest.raises(ConfigError, match=r"car.*red"):
        SwapFile(tmp_path, BATTERY).add([3], WHEN_S, "", None, car, cars)
    assert SwapFile(tmp_path, BATTERY).read() == []


def test_the_simulated_car_and_another_battery_have_swaps_of_their_own(tmp_path):
    other = load_battery("foxbms-2").battery
    files = [SwapFile(tmp_path, BATTERY), SwapFile(tmp_path, BATTERY, simulated=True), SwapFile(tmp_path, other)]
    for k, each in enumerate(files):
        each.add([k], WHEN_S, "", None, "", [])
    assert [[swap.cells for swap in each.read()] for each in files] == [[(0,)], [(1,)], [(2,)]]


@pytest.mark.parametrize("version", [1, 2])
def test_swaps_of_an_earlier_version_are_taken_over_once(tmp_path, version):
    """In its first version they had no car, and count for every one."""
    old_file(tmp_path / "passport.sqlite", version=version)
    swaps = SwapFile(tmp_path, BATTERY)
    car = "red" if version == 2 else None
    kept = [Swap(WHEN_S, (5,), id=8), Swap(WHEN_S + 1, (3, 4), "spare", "ada", car, 7)]
    assert swaps.read() == kept
    (tmp_path / "passport.sqlite").unlink()
    assert swaps.read() == kept
    assert SwapFile(tmp_path, BATTERY, simulated=True).read() == []


def test_what_was_taken_back_is_not_taken_over_again(tmp_path):
    old_file(tmp_path / "passport.sqlite")
    swaps = SwapFile(tmp_path, BATTERY)
    assert swaps.remove(8)
    assert swaps.remove(7)
    assert swaps.read() == []
    swaps.add([1], WHEN_S, "", None, "", [])
    assert len(swaps.read()) == 1


def test_a_first_swap_keeps_those_of_an_earlier_version(tmp_path):
    old_file(tmp_path / "passport.sqlite")
    SwapFile(tmp_path, BATTERY).add([1], WHEN_S + 2, "", None, "", [])
    assert [each.id for each in SwapFile(tmp_path, BATTERY).read()] == [8, 7, 9]


def test_an_old_file_that_cannot_be_read_does_no_harm(tmp_path, caplog):
    (tmp_path / "passport.sqlite").write_bytes(b"no database" * 100)
    swaps = SwapFile(tmp_path, BATTERY)
    assert swaps.read() == []
    assert "passport.sqlite" in caplog.text
    swaps.add([1], WHEN_S, "", None, "", [])
    assert len(swaps.read()) == 1


@pytest.mark.parametrize("content", ["", "{", '[{"cells": 3}]', '{"a": 1}'])
def test_a_damaged_file_is_named_and_never_written_over(tmp_path, content):
    path = tmp_path / "swaps.json"
    path.write_text(content)
    swaps = SwapFile(tmp_path, BATTERY)
    for attempt in (swaps.read, lambda: swaps.remove(1), lambda: swaps.add([1], WHEN_S, "", None, "", [])):
        with pytest.raises(ConfigError, match=r"swaps\.json"):
            attempt()
    assert path.read_text() == content
