"""Every page, on a desktop and on a phone: it renders, fits, and can be used by everybody."""

import json

import pytest
from playwright.sync_api import expect

from tests.campaign import IS_FULL
from tests.e2e.conftest import SIZES, is_too_wide

READS_ONLY = True

PAGES = {  # address, heading, and what is there once the page has its data
    "overview": ("Overview", '[data-testid="cell-30"]'),
    "packs": ("Packs", '[data-testid="cell-30"]'),
    "packs/3/7": ("pack 3, cell 7", '[data-testid="neighbours"]'),
    "charging": ("Charging", '[data-testid="to-full"]'),
    "parameters": ("Parameters", '[data-testid="stored-v_cell_max"]'),
    "can": ("CAN", '[data-testid="can-tx-0"]'),
    "sessions": ("Sessions", '[data-testid="sessions"] td'),
    "season": ("Season", '[data-testid="season-state"]'),
    "events": ("Events", '[data-testid="events"] td'),
    "system": ("System", '[data-testid="disk"]'),
    "simulator": ("Simulator", '[data-testid="scenario-clean-endurance"]'),
    "help": ("Help", "main dl, main table"),
    "judge": ("All cells", '[data-testid="cell-30"], main td'),
}


TOO_SMALL = """[...document.querySelectorAll('.btn, nav a, nav button, input.field, select.field, summary')]
   .filter((e) => e.offsetParent && e.getBoundingClientRect().height < 44)
   .map((e) => e.outerHTML.slice(0, 80))"""


# All pages take their colours from one table a theme, and their layout on a phone from the same parts: in `make test`
# these are looked at in every theme and with axe on a phone, in `make campaign` all of them.
SAMPLE = ("overview", "parameters", "sessions")


@pytest.mark.timeout(300)  # thirteen pages: minutes on a machine with forty other things to do
def test_every_page_renders_fits_and_has_no_accessibility_violation(service, open_page, violations):
    page = open_page(f"{service.base_url}/#/overview")
    found = {}
    for path, (heading, content) in PAGES.items():
        is_looked_at_in_full = path in SAMPLE or IS_FULL
        page.set_viewport_size(SIZES["desktop"])
        page.goto(f"{service.base_url}/#/{path}")
        expect(page.get_by_role("heading", level=1)).to_have_text(heading)
        expect(page.locator(content).first).to_be_visible()
        expect(page.get_by_test_id("link-rs232")).to_have_attribute("data-state", "live")
        problems = violations(page) if is_looked_at_in_full else violations(page, themes=["dark"])
        if is_too_wide(page):
            problems["wider than a desktop"] = []
        page.set_viewport_size(SIZES["phone"])
        if is_looked_at_in_full:
            problems |= {f"phone, {rule}": at for rule, at in violations(page).items()}
        if is_too_wide(page):
            problems["wider than a phone"] = []
        if small := page.evaluate(TOO_SMALL):
            problems["too small for a finger"] = small
        if problems:
            found[path] = problems
    assert not found, json.dumps(found, indent=1)


def test_a_phone_opens_a_page_that_fits_it(service, open_page, violations):
    page = open_page(f"{service.base_url}/#/packs", "phone")
    expect(page.get_by_test_id("cell-30")).to_be_visible()
    assert not is_too_wide(page)
    assert page.evaluate(TOO_SMALL) == []
    assert violations(page) == {}


def test_the_keyboard_reaches_every_page(service, open_page):
    page = open_page(f"{service.base_url}/#/overview")
    page.get_by_role("link", name="Parameters").focus()
    page.keyboard.press("Enter")
    expect(page.get_by_role("heading", level=1)).to_have_text("Parameters")
    page.keyboard.press("Tab")
    expect(page.get_by_role("link", name="CAN", exact=True).last).to_be_focused()


def test_the_theme_is_remembered(service, open_page):
    page = open_page(f"{service.base_url}/#/system")
    page.get_by_role("button", name="sun", exact=True).click()
    page.reload()
    expect(page.locator("html")).to_have_attribute("data-theme", "sun")


def test_nothing_comes_from_another_machine(service, open_page):
    page = open_page(f"{service.base_url}/#/overview")
    expect(page.get_by_test_id("heatmap")).to_be_visible()
    addresses = page.evaluate("performance.getEntriesByType('resource').map((r) => r.name)")
    assert [a for a in addresses if not a.startswith(service.base_url)] == []
