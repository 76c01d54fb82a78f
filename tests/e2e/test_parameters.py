"""A limit is changed before the start: draft, written, read back, stored, still there."""

import re

import pytest
from playwright.sync_api import Page, expect

pytestmark = pytest.mark.parametrize("master", ["simulated", "c"], indirect=True, scope="module")


def confirm(page: Page, button: str) -> None:
    page.get_by_test_id(button).click()
    page.get_by_test_id("confirm").click()


def field(page: Page, name: str):
    return page.get_by_role("textbox", name=name, exact=True)


def test_a_change_is_written_verified_stored_and_survives_the_restart(make_service, open_page):
    service = make_service("--seed", "4")
    page = open_page(f"{service.base_url}/#/parameters", quiet=False)
    expect(page.get_by_test_id("inforce-v_cell_max")).to_contain_text("4.2000")

    field(page, "v_cell_max").fill("4.19")
    expect(page.get_by_test_id("draft-state")).to_have_text("1 value changed")
    expect(page.get_by_test_id("inforce-v_cell_max")).to_contain_text("4.2000")

    page.get_by_test_id("check").click()
    expect(page.get_by_test_id("checked")).to_be_visible()
    with service.client() as client:
        assert client.get("/config").json()["raw"]["v_cell_max"] == 42000

    confirm(page, "write")
    expect(page.get_by_test_id("outcome")).to_contain_text("Written and read back")
    expect(page.get_by_test_id("inforce-v_cell_max")).to_contain_text("4.1900")
    expect(page.get_by_test_id("draft-state")).to_have_text("same as in force")
    with service.client() as client:
        assert client.get("/config").json()["raw"]["v_cell_max"] == 41900

    confirm(page, "store")
    expect(page.get_by_test_id("outcome")).to_contain_text("Stored in the EEPROM")
    expect(page.get_by_test_id("stored-v_cell_max")).to_contain_text("4.1900")
    expect(page.get_by_test_id("stored-state")).to_have_text("same as in force")

    service.stop()
    service.start()
    page = open_page(f"{service.base_url}/#/parameters")
    expect(page.get_by_test_id("inforce-v_cell_max")).to_contain_text("4.1900")
    expect(page.get_by_test_id("stored-v_cell_max")).to_contain_text("4.1900")


def test_a_value_beyond_its_limit_cannot_be_written(service, open_page):
    page = open_page(f"{service.base_url}/#/parameters", quiet=False)
    field(page, "v_cell_max").fill("4.6")
    expect(page.get_by_test_id("param-v_cell_max")).to_contain_text("above the limit of 4.5000 V")
    expect(page.get_by_test_id("write")).to_be_disabled()
    field(page, "v_cell_max").fill("4.18")
    expect(page.get_by_test_id("write")).to_be_enabled()


def test_a_draft_survives_a_reload_and_can_be_discarded(service, open_page):
    page = open_page(f"{service.base_url}/#/parameters", quiet=False)
    field(page, "fan_ramp_stop").fill("48")
    page.reload()
    expect(field(page, "fan_ramp_stop")).to_have_value("48")
    confirm(page, "discard")
    expect(page.get_by_test_id("draft-state")).to_have_text("same as in force")
    expect(field(page, "fan_ramp_stop")).not_to_have_value("48")


def test_two_editors_do_not_overwrite_each_other(service, open_page):
    mine = open_page(f"{service.base_url}/#/parameters", quiet=False)
    theirs = open_page(f"{service.base_url}/#/parameters", quiet=False)
    field(mine, "t_cell_max").fill("50")
    mine.route(
        re.compile(r"/api/v1/config$"),
        lambda route: route.fallback() if route.request.method == "PUT" else route.abort(),
    )
    field(theirs, "fan_ramp_min").fill("20")
    confirm(theirs, "write")
    expect(theirs.get_by_test_id("outcome")).to_contain_text("Written and read back")
    confirm(mine, "write")
    expect(mine.get_by_test_id("outcome")).to_contain_text("Nothing was written")
    expect(field(mine, "t_cell_max")).to_have_value("50")
    mine.unroute_all()
    mine.reload()
    expect(field(mine, "t_cell_max")).to_have_value("50")
    confirm(mine, "write")
    expect(mine.get_by_test_id("outcome")).to_contain_text("Written and read back")
    with service.client() as client:
        assert client.get("/config").json()["raw"]["t_cell_max"] == 50


def test_a_parameter_is_found_by_its_meaning(service, open_page):
    page = open_page(f"{service.base_url}/#/parameters", quiet=False)
    page.get_by_role("searchbox").fill("hottest cell")
    expect(page.get_by_test_id("param-fan_ramp_start")).to_be_visible()
    expect(page.get_by_test_id("param-v_cell_max")).to_have_count(0)
