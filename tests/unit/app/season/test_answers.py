"""In a worker process with the memory that the smallest machine leaves it."""

import pytest

from app.estimation.cell_model.cell_file import load_cell
from app.season.answers import LIMITS, overviews_at
from app.season.history import SeasonSource
from app.sessions.worker import JobLimits, Workers
from app.sessions.worker.workers import LEAST_BYTES
from app.sources.loaded_battery import team_battery


@pytest.fixture
def workers():
    made = Workers()
    yield made
    made.close()


def overviews(workers, folder):
    source = SeasonSource(str(folder), team_battery().battery, False, load_cell("samsung-25r-10p"))
    return workers.run(JobLimits(LIMITS.cpu_s, LEAST_BYTES), overviews_at, source, set(), "")


def test_a_season_without_sessions_needs_little_memory(workers, tmp_path):
    assert overviews(workers, tmp_path) == ({}, [])


def test_a_season_needs_little_memory(workers, lake):
    car_of, _ = overviews(workers, lake)
    assert len(car_of) == 1
