"""`voltwall season simulate`: a session of the simulated car is recorded whole, on its day, in the car's time."""

import time

import pytest

from app.commands import season_simulate
from app.sessions.reading.reader import SessionFile

REST_S, DRIVE_S, DAYS = 2.0, 30.0, 30.0
LENGTH_S = 2 * REST_S + DRIVE_S + season_simulate.LEFT_S


@pytest.mark.timeout(120)
def test_a_session_is_recorded_whole_on_its_day(voltwall, tmp_path, monkeypatch):
    monkeypatch.setattr(season_simulate, "REST_S", REST_S)
    begun_s = time.time()
    words = ("--sessions", "1", "--days", f"{DAYS:g}", "--drive-s", f"{DRIVE_S:g}")
    done = voltwall("season", "simulate", *words, "--data", str(tmp_path))
    assert done.returncode == 0, done.stderr
    (path,) = (tmp_path / "sessions").glob("*.sqlite")
    with SessionFile(path) as session:
        info = session.info
    assert info.is_closed
    assert 0.7 * LENGTH_S < info.duration_s < LENGTH_S + 1  # the line is opened after the car has started
    day_s = begun_s - DAYS * 86_400 - LENGTH_S
    assert day_s < info.started_wall_ns / 1e9 < day_s + 60
