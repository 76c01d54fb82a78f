"""The page of a season: two cars with one battery are kept apart."""

import numpy as np
import pytest
from playwright.sync_api import expect

from app.estimation.cell_model.cell_file import format_cell, load_cell
from app.season.lake.build import build_lake, session_files
from app.season.lake.place import Place
from tests.recorded.arrays import START_S, SessionMaker

CELL = load_cell("samsung-25r-10p")
TIME_S = np.arange(0.0, 60.0, 0.25)
CURRENT_A = np.where((TIME_S > 11) & (TIME_S < 55), 60 + 50 * np.sin(TIME_S), 0.0)
DAY_S, DAYS = 86_400.0, 6
WEAK = {"E 25": 60, "E 26": 30}
SIXTH, THIRD = "pack 6, cell 1", "pack 3, cell 7"  # their names: eight packs of twelve
OHM, WEAK_OHM = 0.002, 0.003


@pytest.fixture(scope="module")
def page_of(make_module_service, tmp_path_factory):
    """The service of a season in which both cars drive on six days."""
    data = tmp_path_factory.mktemp("season")
    make = SessionMaker(data / "sessions")
    for day in range(DAYS):
        for hour, (car, weak) in enumerate(WEAK.items()):
            ohm = np.where(np.arange(96) == weak, WEAK_OHM, OHM)
            volts = CELL.ocv.voltage(0.8) - CURRENT_A[:, None] * ohm
            metadata = {"source": "simulator", "car": car}
            start_s = START_S + day * DAY_S + hour * 3600
            make(TIME_S, CURRENT_A, volts, 25, start_s=start_s, cell_file=format_cell(CELL), metadata=metadata)
    build_lake(Place(data / "lake"), session_files([data / "sessions"]))
    service = make_module_service("--seed", "5", "--no-record", "--no-season", data=data)
    return lambda query="": f"{service.base_url}/#/season{query}"


def test_two_cars_with_one_battery_have_trends_ranking_and_sessions_of_their_own(page_of, open_page):
    page = open_page(page_of())
    cars = page.get_by_test_id("season-overview")
    expect(cars).to_have_count(2)
    for car, weakest, other in ((cars.nth(0), SIXTH, THIRD), (cars.nth(1), THIRD, SIXTH)):
        ranking = car.get_by_test_id("season-ranking")
        expect(ranking.locator("tbody tr").first).to_contain_text(weakest)
        expect(ranking).not_to_contain_text(other)
    expect(page.get_by_test_id("season-state")).to_contain_text("12 sessions")
    cars.nth(1).get_by_role("button", name=THIRD).click()
    expect(page.get_by_test_id("season-cell").get_by_role("heading", level=3)).to_have_text(
        ["e-25-simulated", "e-26-simulated"]
    )
    page.get_by_test_id("season-car").select_option("e-26-simulated")
    expect(cars).to_have_count(1)
    expect(page.get_by_test_id("season-state")).to_contain_text("6 sessions")
    expect(page.get_by_test_id("season-sessions").locator("tbody tr")).to_have_count(6)
