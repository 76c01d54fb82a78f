"""The page of a season: two cars with one battery are kept apart, and so are the modules of a cell."""

import re

import numpy as np
import pytest
from playwright.sync_api import expect

from app.estimation.cell_model.cell_file import format_cell, load_cell
from app.season.lake.build import build_lake, session_files
from app.season.lake.place import LakeFolder
from tests.e2e.conftest import is_too_wide
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
    build_lake(LakeFolder(data / "lake"), session_files([data / "sessions"]))
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


def test_a_swap_is_recorded_on_a_phone_of_the_car_that_is_chosen(page_of, open_page, violations):
    page = open_page(page_of("?cell=30"), "phone")
    expect(page.get_by_test_id("season-cell-sessions")).to_have_count(2)
    expect(page.get_by_test_id("swap")).to_be_disabled()  # no car is chosen
    page.get_by_test_id("season-car").select_option("e-26-simulated")
    rows = page.get_by_test_id("season-cell-sessions").locator("tbody tr")
    expect(rows).to_have_count(DAYS)
    expect(page.get_by_test_id("season-cell")).to_contain_text("% of cell model")
    page.get_by_role("textbox", name="Note").fill("spare 4")
    page.get_by_label("When").fill("2026-09-24T00:00")
    page.get_by_test_id("swap").click()
    expect(page.get_by_text("spare 4")).to_be_visible()
    module = rows.locator("td:nth-child(2)")
    expect(module).to_have_text(["2"] * 3 + ["1"] * 3)
    assert not is_too_wide(page)
    assert violations(page) == {}
    page.get_by_test_id("season-car").select_option("e-25-simulated")
    expect(page.get_by_text("No swaps recorded.")).to_be_visible()
    expect(module).to_have_text(["1"] * DAYS)


def test_a_cell_leads_to_its_season(page_of, open_page):
    page = open_page(page_of().replace("season", "packs/3/7"))
    page.get_by_test_id("cell-season").click()
    expect(page).to_have_url(re.compile("season.cell=30"))
    expect(page.get_by_test_id("season-cell").get_by_role("heading", level=2)).to_have_text(THIRD)
    expect(page.get_by_test_id("season-cell-choice")).to_be_in_viewport()  # below all that is said of packs
    page.get_by_test_id("season-cell-choice").select_option(label=SIXTH)
    expect(page.get_by_test_id("season-cell").get_by_role("heading", level=2)).to_have_text(SIXTH)
    expect(page).to_have_url(re.compile("cell=60"))
