"""What the page of parameters does by itself, whatever the master: limits, reasons, profiles, drafts, commands.

What the service does with either master below these pages: `tests/integration/test_config_service.py`.
"""

import re
from pathlib import Path

import pytest
from playwright.sync_api import expect

from tests.e2e.test_parameters import confirm, field

FIRST_MAP = Path(__file__).parents[1] / "recorded" / "first_map"


@pytest.fixture(scope="module")
def scenario():
    return "in-the-pit"


def test_a_draft_is_judged_against_limits_and_rules_survives_a_reload_and_can_be_discarded(service, open_page):
    page = open_page(f"{service.base_url}/#/parameters", quiet=False)
    field(page, "v_cell_max").fill("4.6")
    expect(page.get_by_test_id("param-v_cell_max")).to_contain_text("above the limit of 4.5000 V")
    expect(page.get_by_test_id("write")).to_be_disabled()
    field(page, "v_cell_max").fill("4.18")
    expect(page.get_by_test_id("write")).to_be_enabled()

    field(page, "t_cell_max").fill("65")
    page.get_by_test_id("write").click()
    expect(page.get_by_test_id("outcome")).to_contain_text("t_cell_max = 65 °C, allowed: at most 60 °C (rule limit")
    expect(page.get_by_test_id("write-dialog")).to_have_count(0)

    field(page, "fan_ramp_stop").fill("48")
    page.reload()
    expect(field(page, "fan_ramp_stop")).to_have_value("48")
    page.get_by_test_id("discard").click()
    expect(page.get_by_test_id("draft-state")).to_have_text("none")
    expect(field(page, "fan_ramp_stop")).not_to_have_value("48")
    page.get_by_test_id("undo").get_by_role("button", name="Undo").click()
    expect(field(page, "fan_ramp_stop")).to_have_value("48")
    page.get_by_test_id("discard").click()
    expect(page.get_by_test_id("draft-state")).to_have_text("none")

    page.get_by_role("searchbox").fill("hottest cell")
    expect(page.get_by_test_id("param-fan_ramp_start")).to_be_visible()
    expect(page.get_by_test_id("param-v_cell_max")).to_have_count(0)


def test_a_row_shows_what_is_accepted_and_a_looser_protection_asks_why(service, open_page):
    page = open_page(f"{service.base_url}/#/parameters", quiet=False)
    confirm(page, "store")
    expect(page.get_by_test_id("outcome")).to_contain_text("Stored in EEPROM")
    row = page.get_by_test_id("param-t_cell_max")
    expect(row).to_contain_text("0 to 60 °C")
    field(page, "t_cell_max").fill("75")
    expect(row).to_contain_text("outside 0 to 60 °C")
    field(page, "t_cell_max").fill("46")
    page.get_by_test_id("write").click()
    expect(page.get_by_test_id("write-dialog")).to_contain_text("the master would trip later than now")
    expect(page.get_by_test_id("confirm")).to_be_disabled()
    page.get_by_test_id("reason").fill("measured with a second sensor")
    page.get_by_test_id("confirm").click()
    expect(page.get_by_test_id("outcome")).to_contain_text("Not in EEPROM yet")
    field(page, "t_cell_max").fill("45")
    confirm(page, "write")  # back to what the EEPROM holds: no reason
    expect(page.get_by_test_id("outcome")).to_contain_text("The EEPROM contains the same configuration")


def test_a_refused_value_of_a_table_is_marked_where_it_stands(service, open_page):
    page = open_page(f"{service.base_url}/#/parameters", quiet=False)
    table = page.get_by_test_id("param-can_tx_msg_id")
    table.locator("summary").click()
    expect(table).to_contain_text("checked together")
    second, third = (page.get_by_role("textbox", name=f"can_tx_msg_id, {n}", exact=True) for n in (2, 3))
    third.fill(second.input_value())
    expect(third).to_have_attribute("aria-invalid", "false")
    page.get_by_test_id("check").click()
    expect(page.get_by_test_id("outcome")).to_contain_text("tx 2")
    expect(third).to_have_attribute("aria-invalid", "true")
    expect(third).to_have_attribute("title", re.compile("tx 2"))
    expect(second).to_have_attribute("aria-invalid", "false")


def test_a_profile_is_kept_and_taken_as_the_draft(service, open_page):
    page = open_page(f"{service.base_url}/#/parameters")
    expect(page.get_by_test_id("inforce-v_cell_chrg")).to_contain_text("4.1500")
    page.get_by_test_id("tab-profiles").click()
    page.get_by_test_id("profile-name").fill("dry")
    page.get_by_test_id("profile-save").click()
    expect(page.get_by_test_id("profile-dry")).to_contain_text("version 1")
    page.get_by_test_id("tab-values").click()
    field(page, "v_cell_chrg").fill("4.1")
    confirm(page, "write")
    expect(page.get_by_test_id("outcome")).to_contain_text("Written and verified")
    page.get_by_test_id("tab-profiles").click()
    page.get_by_role("button", name="Add to changes").click()
    expect(page.get_by_test_id("draft-state")).to_have_text("1 value changed")
    expect(field(page, "v_cell_chrg")).to_have_value("4.1500")
    page.get_by_test_id("tab-compare").click()
    page.get_by_test_id("compare-a").select_option("profile:dry@1")
    expect(page.get_by_test_id("compare")).to_contain_text("4.1500 V → 4.1000 V")
    page.get_by_test_id("discard").click()
    expect(page.get_by_test_id("draft-state")).to_have_text("none")


def test_a_profile_of_an_older_map_is_marked_as_converted(service, open_page):
    page = open_page(f"{service.base_url}/#/parameters")
    page.get_by_test_id("tab-profiles").click()
    page.get_by_test_id("profile-file").set_input_files(FIRST_MAP / "profile.json")
    kept = page.get_by_test_id("profile-profile")
    expect(kept).to_contain_text("converted from an older memory map")
    expect(kept).to_contain_text("3b6bf984ad19a456")
    page.get_by_test_id("profile-name").fill("of-now")
    page.get_by_test_id("profile-save").click()
    expect(page.get_by_test_id("profile-of-now")).to_contain_text("version 1")
    expect(page.get_by_test_id("profile-of-now")).not_to_contain_text("converted")


def test_while_the_car_drives_the_page_says_why_not(make_service, open_page):
    driving = make_service("--seed", "4")
    driving.wait_for(lambda s: s["master"]["state"] == "drive" and s["config_hash"] and s["master"]["map_matches"])
    page = open_page(f"{driving.base_url}/#/parameters")
    field(page, "v_cell_max").fill("4.19")
    page.get_by_test_id("write").click()
    expect(page.get_by_test_id("block-reason")).to_contain_text(
        "blocked while the contactors are closed. Open the contactors to change v_cell_max"
    )
    expect(page.get_by_test_id("confirm")).to_be_disabled()


def test_the_current_sensor_is_zeroed_and_cells_are_bled_by_hand(service, open_page):
    with service.client() as client:
        tag = client.get("/config").headers["ETag"]
        client.put("/config", json={"raw": {"i_offset": 20540}}, headers={"If-Match": tag}).raise_for_status()
    page = open_page(f"{service.base_url}/#/parameters")
    page.get_by_test_id("tab-commands").click()
    page.get_by_test_id("take-zero").click()
    page.get_by_role("button", name="Add to changes").click()
    confirm(page, "write")
    expect(page.get_by_test_id("outcome")).to_contain_text("Written and verified")
    page.get_by_label("pack 2, cell 3").check()
    confirm(page, "command-balance-cells")
    service.wait_for(lambda s: [i for i, b in enumerate(s["cells"]["balancing"]) if b] == [14])
    page.get_by_test_id("by-hand").get_by_test_id("command-balance-stop").click()
    page.get_by_test_id("confirm").click()
    service.wait_for(lambda s: not any(s["cells"]["balancing"]))


def test_charging_offers_every_way_to_balance(service, open_page):
    page = open_page(f"{service.base_url}/#/charging")
    for name in ("charge-start", "charge-stop", "balance-start", "balance-cells"):
        expect(page.get_by_test_id(f"command-{name}")).to_be_visible()
    page.get_by_role("link", name="all commands").click()
    expect(page.get_by_test_id("slave-check")).to_be_visible()
    expect(page.get_by_test_id("tab-commands")).to_have_attribute("aria-pressed", "true")


def test_where_the_rules_forbid_balancing_with_open_relays_the_page_says_so(make_service, open_page):
    strict = make_service("--scenario", "in-the-pit", "--no-balance-open")
    strict.wait_for(lambda s: s["master"]["flags"] is not None)
    page = open_page(f"{strict.base_url}/#/charging")
    expect(page.get_by_test_id("blocks-balance-cells")).to_contain_text("disabled by the setting balance_open")
    page.get_by_label("pack 2, cell 3").check()
    for name in ("balance-start", "balance-cells"):
        expect(page.get_by_test_id(f"command-{name}")).to_be_disabled()
    for stop in page.get_by_test_id("command-balance-stop").all():
        expect(stop).to_be_enabled()


def test_a_warning_needs_a_reason_and_the_write_is_rolled_back_from_the_history(service, open_page):
    page = open_page(f"{service.base_url}/#/parameters")
    field(page, "i_disc_max").fill("210")
    page.get_by_test_id("write").click()
    expect(page.get_by_test_id("write-dialog")).to_contain_text("reason required")
    expect(page.get_by_test_id("confirm")).to_be_disabled()
    page.get_by_test_id("reason").fill("ten second pulses")
    page.get_by_test_id("confirm").click()
    expect(page.get_by_test_id("outcome")).to_contain_text("Written and verified")

    page.get_by_test_id("tab-history").click()
    newest = page.get_by_test_id("history").get_by_role("listitem").first
    expect(newest).to_contain_text("ten second pulses")
    newest.get_by_role("button", name="Roll back").click()
    page.get_by_test_id("confirm").click()
    expect(page.get_by_test_id("outcome")).to_contain_text("Rolled back and verified")
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
    expect(theirs.get_by_test_id("outcome")).to_contain_text("Written and verified")
    mine.get_by_test_id("confirm").click()
    expect(mine.get_by_test_id("outcome")).to_contain_text("Nothing was written")
    expect(mine.get_by_test_id("outcome")).to_contain_text("fan_ramp_min")
    expect(field(mine, "t_cell_max")).to_have_value("44")
    mine.unroute_all()
    mine.reload()
    expect(field(mine, "t_cell_max")).to_have_value("44")
    confirm(mine, "write")
    expect(mine.get_by_test_id("outcome")).to_contain_text("Written and verified")
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
    expect(panel.get_by_test_id("slave-verdict")).to_contain_text("Cells 1 are out of tolerance.")
    panel.get_by_label("Meter at cell 1", exact=True).fill(f"{read:.4f}")
    panel.get_by_label("Tolerance, mV").fill("2")
    panel.get_by_test_id("slave-compare").click()
    expect(panel.get_by_test_id("slave-verdict")).to_contain_text("All compared cells are within 3.2 mV")
    expect(row.get_by_role("cell").nth(3)).to_have_text(re.compile(r"^−(19|20|21)\.\d$"))
