"""A limit is changed before the start: draft, written, read back, stored, still there; on either master."""

from playwright.sync_api import Page, expect


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
    expect(page.get_by_test_id("outcome")).to_contain_text("Written and verified")
    expect(page.get_by_test_id("outcome")).to_contain_text("Not in EEPROM yet")
    expect(page.get_by_test_id("inforce-v_cell_max")).to_contain_text("4.1900")
    expect(page.get_by_test_id("draft-state")).to_have_text("none")
    with service.client() as client:
        assert client.get("/config").json()["raw"]["v_cell_max"] == 41900

    confirm(page, "store")
    expect(page.get_by_test_id("outcome")).to_contain_text("Stored in EEPROM")
    expect(page.get_by_test_id("stored-v_cell_max")).to_contain_text("4.1900")
    expect(page.get_by_test_id("stored-state")).to_have_text("none")

    service.stop()
    service.start()
    page = open_page(f"{service.base_url}/#/parameters")
    expect(page.get_by_test_id("inforce-v_cell_max")).to_contain_text("4.1900")
    expect(page.get_by_test_id("stored-v_cell_max")).to_contain_text("4.1900")
