"""Times of files come from clocks that were set to anything: each is a time of day, and no list ends at one."""

import sqlite3

import numpy as np
import pytest

from app.cli import main


@pytest.fixture(params=[2**63 - 1, -(2**63), -1], ids=["last", "first", "before 1970"])
def session(make_session, request):
    """A session whose clock was set to the ends of 64 bits."""
    time_s = np.arange(0.0, 60.0, 0.5)
    path = make_session(time_s, 80 + 40 * np.sin(time_s), 3.7, 25, 0.8)
    with sqlite3.connect(path) as connection:
        assert connection.execute("UPDATE meta SET value = ? WHERE key = 'start_wall_ns'", (request.param,)).rowcount
    return path


@pytest.mark.parametrize(
    "command",
    [["list"], ["show", "ID"], ["report", "ID"], ["laps", "ID"], ["prune", "--older-than", "3"]],
)
def test_a_session_of_any_clock_is_shown(session, command, capsys):
    given = [session.stem if each == "ID" else each for each in command]
    assert main(["sessions", *given, "--data", str(session.parents[1])]) == 0
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.parametrize("ending", ["csv", "ld", "mcap"])
def test_a_session_of_any_clock_is_exported(session, ending, tmp_path):
    assert main(["export", str(session), "--out", str(tmp_path / f"a.{ending}")]) == 0


def test_a_session_of_any_clock_is_found_in_a_season(session):
    assert main(["season", "build", "--data", str(session.parents[1])]) == 0
