"""A recorded season, and its lake."""

from pathlib import Path

import pytest

from tests.recorded.season import make_lake, make_season


@pytest.fixture(scope="session")
def season(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of two sessions; tests that change something copy it."""
    return make_season(tmp_path_factory.mktemp("season") / "sessions")


@pytest.fixture(scope="session")
def lake(season: Path) -> Path:
    """The lake of these sessions."""
    return make_lake(season)
