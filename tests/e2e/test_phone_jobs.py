"""Whole jobs with a thumb: a parameter written and stored, a charge started and stopped."""

import re

import pytest
from playwright.sync_api import Page, expect

from tests.e2e.conftest import COUNT_CLICKS, spent

PASSWORDS = {"VOLTWALL_PASSWORD": "engineer-pass-1", "VOLTWALL_VIEWER_PASSWORD": "viewer-pass-1"}


@pytest.fixture
def phone(open_page):
    """A phone on a page of a service: screen, touch and no mouse; logged in as the electronics lead if it must be."""

    def open_one(service, path: str, *, guarded: bool = False) -> Page:
        page = open_page(f"{service.base_url}/#/{path}", "phone", quiet=not guarded)  # at first the log-in is a 401
        if guarded:
            page.get_by_role("textbox", name="Name").fill("lead")
            page.get_by_role("textbox", name="Password").fill("engineer-pass-1")
            page.get_by_role("button", name="Log in").tap()
        expect(page.get_by_test_id("link-rs232")).to_have_attribute("data-state", "live")
        assert page.evaluate("matchMedia('(pointer: coarse)').matches")
        return page

    return open_one


def test_a_limit_is_written_verified_and_stored(make_service, phone, tell):
    service = make_service("--seed", "4", "--scenario", "in-the-pit", **PASSWORDS)
    page = phone(service, "overview", guarded=True)
    page.evaluate(COUNT_CLICKS)
    page.get_by_role("link", name="Parameters").tap()
    page.get_by_role("textbox", name="v_cell_max", exact=True).fill("4.18")
    for button, said in (("write", "Written and verified"), ("store", "Stored in EEPROM")):
        page.get_by_test_id(button).tap()
        page.get_by_test_id("confirm").tap()
        expect(page.get_by_test_id("outcome")).to_contain_text(said)
        clicks, told = spent(page)
        assert clicks == {"write": 3, "store": 5}[button]
        tell(f"a limit, up to {button}: {told}")
    expect(page.get_by_test_id("inforce-v_cell_max")).to_contain_text("4.1800")
    expect(page.get_by_test_id("stored-v_cell_max")).to_contain_text("4.1800")
    page.get_by_test_id("tab-history").tap()
    expect(page.get_by_role("main").get_by_text("lead").first).to_be_visible()


CHARGER_PLUGGED_IN = """
title = "Plugged in"
description = "A charger is there; nobody but the person at the page starts it."
[start]
soc = 0.5
[[phase]]
load = "charge-by-hand"
for_s = 3600
"""


def test_a_charge_is_started_watched_and_stopped(make_service, phone, tmp_path):
    (tmp_path / "plugged-in.toml").write_text(CHARGER_PLUGGED_IN)
    service = make_service("--seed", "6", "--scenario", str(tmp_path / "plugged-in.toml"))
    service.wait_for(lambda s: s["accumulator"]["loaded_cells"] == 96)
    page = phone(service, "charging")
    steps = page.get_by_role("list", name="Charging state")
    expect(steps.locator("[aria-current]")).to_have_text("Off")
    page.get_by_role("button", name="Start charging").tap()
    page.get_by_test_id("confirm").tap()
    expect(steps.locator("[aria-current]")).to_have_text("Constant current")
    service.wait_for(lambda s: s["accumulator"]["current_a"] < -1)
    expect(page.get_by_test_id("given-current")).to_contain_text(re.compile(r"[1-9]"))
    expect(page.get_by_test_id("to-full")).to_contain_text(":")
    expect(page.get_by_test_id("why-not")).to_have_count(0)
    page.get_by_role("button", name="Stop charging").tap()
    page.get_by_test_id("confirm").tap()
    expect(steps.locator("[aria-current]")).to_have_text("Off")
    service.wait_for(lambda s: abs(s["accumulator"]["current_a"]) < 1)
