"""The pages in another language than English."""

from playwright.sync_api import expect


def test_norwegian_is_chosen_remembered_and_left_again(service, open_page):
    page = open_page(f"{service.base_url}/#/system")
    page.get_by_role("button", name="Norsk").click()
    expect(page.locator("html")).to_have_attribute("lang", "nb")
    expect(page.get_by_role("link", name="Pakker", exact=True).last).to_be_visible()
    page.reload()
    page.goto(f"{service.base_url}/#/packs/3/7")
    expect(page.get_by_role("heading", level=1)).to_have_text("pakke 3, celle 7")
    page.goto(f"{service.base_url}/#/system")
    page.get_by_role("button", name="English").click()
    expect(page.get_by_role("heading", name="Age of each part")).to_be_visible()
