"""The pages in another language than English."""

import re

from playwright.sync_api import expect

READS_ONLY = True


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
    expect(page.get_by_role("heading", name="Data age")).to_be_visible()


def test_a_limit_is_edited_in_norwegian(service, open_page):
    page = open_page(f"{service.base_url}/#/system", quiet=False)
    page.get_by_role("button", name="Norsk").click()
    page.goto(f"{service.base_url}/#/parameters")
    expect(page.get_by_role("heading", name="cellegrenser")).to_be_visible()
    limit = page.get_by_role("textbox", name="v_cell_max", exact=True)
    limit.fill("4.6")
    expect(page.get_by_test_id("param-v_cell_max")).to_contain_text("over grensen på 4.5000 V")
    limit.fill("4.19")
    expect(page.get_by_test_id("draft-state")).to_have_text("1 verdi endret")
    page.get_by_test_id("discard").click()
    expect(page.get_by_test_id("draft-state")).to_have_text("ingen")


ENGLISH = r"\b(the|and|with|was|were|this|that|cell|cells|pack|while|has)\b"
PAGES = (
    "overview",
    "packs",
    "packs/3/7",
    "charging",
    "parameters",
    "sessions",
    "season",
    "events",
    "system",
    "simulator",
    "help",
)


def test_no_english_is_left_on_a_norwegian_page(service, open_page):
    page = open_page(f"{service.base_url}/#/system")
    page.get_by_role("button", name="Norsk").click()
    with service.client() as client:
        battery = re.escape(client.get("/battery").json()["name"])  # in the language of who wrote its profile
    names = re.compile(rf"{battery}|\b\w+(-\w+)+\b")  # and of scenarios and faults, as the command line takes them
    found = {}
    for path in PAGES:
        page.goto(f"{service.base_url}/#/{path}")
        expect(page.locator("html")).to_have_attribute("lang", "nb")
        expect(page.locator("main h1")).to_be_visible()
        expect(page.locator("main")).to_contain_text(re.compile(".{120}", re.DOTALL))
        page.add_style_tag(content="code { display: none }")  # what a machine reads is in no language
        lines = page.locator("main").inner_text().splitlines()
        found[path] = [line for line in lines if re.search(ENGLISH, names.sub("", line))]
    assert {path: lines for path, lines in found.items() if lines} == {}
