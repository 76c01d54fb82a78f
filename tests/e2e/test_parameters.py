"""A limit is changed before the start: draft, written, read back, stored, still there; on either master."""

import re

import pytest
from playwright.sync_api import Page, expect

MASTERS = ("simulated", "c")


@pytest.fixture(scope="module")
def scenario():
    return "in-the-pit"


def confirm(page: Page, button: str) -> None:
    page.get_by_test_id(button).click()
    page.get_by_test_id("confirm").click()


def field(page: Page, name: str):
    return page.get_by_role("textbox", name=name, exact=True)


def test_a_change_is_written_verified_stored_and_survives_the_restart(make_service, open_page):
    service = make_service("--seed", "4", "--scenario", "in-the-pit")
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
    expect(page.get_by_test_id("outcome")).to_contain_text("The EEPROM does not hold it")
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


def test_a_warning_needs_a_reason_and_the_write_is_rolled_back_from_the_history(service, open_page):
    page = open_page(f"{service.base_url}/#/parameters")
    field(page, "i_disc_max").fill("210")
    page.get_by_test_id("write").click()
    expect(page.get_by_test_id("write-dialog")).to_contain_text("needs a reason")
    expect(page.get_by_test_id("confirm")).to_be_disabled()
    page.get_by_test_id("reason").fill("ten second pulses")
    page.get_by_test_id("confirm").click()
    expect(page.get_by_test_id("outcome")).to_contain_text("Written and read back")

    page.get_by_test_id("tab-history").click()
    newest = page.get_by_test_id("history").get_by_role("listitem").first
    expect(newest).to_contain_text("ten second pulses")
    newest.get_by_role("button", name="Roll back").click()
    page.get_by_test_id("confirm").click()
    expect(page.get_by_test_id("outcome")).to_contain_text("Rolled back and read back")
    page.get_by_test_id("tab-values").click()
    expect(page.get_by_test_id("inforce-i_disc_max")).to_contain_text("200")


def test_two_editors_do_not_overwrite_each_other(service, open_page):
    mine = open_page(f"{service.base_url}/#/parameters", quiet=False)
    theirs = open_page(f"{service.base_url}/#/parameters", quiet=False)
    field(mine, "t_cell_max").fill("44")
    mine.route(  # this page does not hear of the other's write
        re.compile(r"/api/v1/config$"),
        lambda route: route.fallback() if route.request.method == "PUT" else route.abort(),
    )
    mine.get_by_test_id("write").click()
    expect(mine.get_by_test_id("write-dialog")).to_be_visible()
    field(theirs, "fan_ramp_min").fill("20")
    confirm(theirs, "write")
    expect(theirs.get_by_test_id("outcome")).to_contain_text("Written and read back")
    mine.get_by_test_id("confirm").click()
    expect(mine.get_by_test_id("outcome")).to_contain_text("Nothing was written")
    expect(mine.get_by_test_id("outcome")).to_contain_text("fan_ramp_min")
    expect(field(mine, "t_cell_max")).to_have_value("44")
    mine.unroute_all()
    mine.reload()
    expect(field(mine, "t_cell_max")).to_have_value("44")
    confirm(mine, "write")
    expect(mine.get_by_test_id("outcome")).to_contain_text("Written and read back")
    with service.client() as client:
        assert client.get("/config").json()["raw"]["t_cell_max"] == 44


def test_a_slave_is_checked_against_a_meter_on_the_page(service, open_page):
    page = open_page(f"{service.base_url}/#/parameters/commands")
    panel = page.get_by_test_id("slave-check")
    panel.get_by_label("Pack").select_option("2")
    panel.get_by_test_id("slave-read").click()
    row = panel.get_by_role("row").nth(1)
    expect(row.get_by_role("cell").nth(0)).to_have_text(re.compile(r"^[34]\.\d{4}$"))
    read = float(row.get_by_role("cell").nth(0).inner_text())
    panel.get_by_label("Meter at cell 1", exact=True).fill(f"{read + 0.02:.4f}".replace(".", ","))
    panel.get_by_test_id("slave-compare").click()
    expect(panel.get_by_test_id("slave-verdict")).to_contain_text("Out of tolerance: cells 1.")
    panel.get_by_label("Meter at cell 1", exact=True).fill(f"{read:.4f}")
    panel.get_by_label("It may be off, mV").fill("2")
    panel.get_by_test_id("slave-compare").click()
    expect(panel.get_by_test_id("slave-verdict")).to_contain_text("All compared cells are within 3.2 mV")
    expect(row.get_by_role("cell").nth(3)).to_have_text(re.compile(r"^−(19|20|21)\.\d$"))
