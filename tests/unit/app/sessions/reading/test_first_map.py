"""A session of the first memory map, recorded by the program of the day before it changed, tells what it told then."""

import json
import lzma
import shutil
import sqlite3
from pathlib import Path

import numpy as np
import pytest

from app.sessions.reading.reader import SessionFile
from firmware_protocol.config_image import unit_value
from firmware_protocol.older_maps import FIRST_MAP

RECORDED = Path(__file__).parents[4] / "recorded" / "first_map"
VALUES = json.loads((RECORDED / "values.json").read_text())  # read by that program
SIGNALS = [name for name in VALUES if name != "configs"]


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("first_map") / "20261123T145728Z.sqlite"
    path.write_bytes(lzma.decompress((RECORDED / "session.sqlite.xz").read_bytes()))
    return path


def assert_as_then(path):
    with SessionFile(path) as session:
        assert session.info.map_hash == FIRST_MAP
        start_s = session.info.started_wall_ns / 1e9
        for name in SIGNALS:
            series = session.series([name])[name]
            assert series.unit == VALUES[name]["unit"], name
            assert series.time_s - start_s == pytest.approx(VALUES[name]["time_s"], abs=1e-5), name
            assert series.minimum == pytest.approx(VALUES[name]["values"], rel=1e-9), name
            assert series.maximum == pytest.approx(VALUES[name]["values"], rel=1e-9), name


def test_every_value_is_that_of_then(path):
    assert_as_then(path)


def test_so_it_is_where_the_recorder_was_cut_off(path, tmp_path):
    cut_off = tmp_path / path.name
    shutil.copy(path, cut_off)
    with sqlite3.connect(cut_off) as database:
        for table in ("chunks", "tracks", "columns", "series"):
            database.execute(f"DELETE FROM {table}")
    database.close()
    assert_as_then(cut_off)


def test_it_is_sound_and_a_changed_column_is_noticed(path, tmp_path):
    with SessionFile(path) as session:
        assert session.problems() == []
    damaged = tmp_path / path.name
    shutil.copy(path, damaged)
    with sqlite3.connect(damaged) as database:
        database.execute("UPDATE series SET field = 'r_fc' WHERE field = 'dod'")
    database.close()
    with SessionFile(damaged) as session:
        assert any(problem.startswith("columns") for problem in session.problems())


def test_the_period_has_no_signal_of_its_own_there(path):
    with SessionFile(path) as session:
        assert "conf.ts" in session.signal_names()
        assert "conf.telemetry_period" not in session.signal_names()
        assert "conf.telemetry_period" not in session.signals.order


def test_its_configurations_are_those_of_now(path):
    with SessionFile(path) as session:
        found = [[unit_value(each.image, name) for name in ("telemetry_period", "ts")] for each in session.configs()]
        assert [each.image.hex() for each in session.configs_as_recorded()] == VALUES["configs"]
    assert found == [[100, 100], [250, 100]]


def test_the_charge_drawn_moves_as_the_current_says(path):
    """Another judge of the scale: ampere hours out of the recorded current, against the steps of `dod`."""
    with SessionFile(path) as session:
        current, drawn = (session.series([name])[name] for name in ("i_fs", "dod"))
    seconds = np.diff(current.time_s, append=current.time_s[-1])
    assert drawn.minimum[-1] - drawn.minimum[0] == pytest.approx(float(current.minimum @ seconds) / 3600, rel=0.05)
