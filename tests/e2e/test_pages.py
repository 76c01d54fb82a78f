"""Every page, on a desktop and on a phone: it renders, fits, and can be used by everybody."""

import json

import pytest
from playwright.sync_api import expect

READS_ONLY = True

PAGES = {
    "overview": "Overview",
    "packs": "Packs",
    "packs/3/7": "pack 3, cell 7",
    "charging": "Charging",
    "parameters": "Parameters",
    "can": "CAN",
    "sessions": "Sessions",
    "events": "Events",
    "system": "System",
    "simulator": "Simulator",
    "help": "Help",
    "judge": "All cells",
}


@pytest.mark.parametrize("size", ["desktop", "phone"])
@pytest.mark.parametrize(("path", "heading"), PAGES.items())
def test_a_page_renders_fits_and_has_no_accessibility_violation(service, open_page, violations, path, heading, size):
    page = open_page(f"{service.base_url}/#/{path}", size)
    expect(page.get_by_role("heading", level=1)).to_have_text(heading)
    expect(page.get_by_test_id("link-rs232")).to_have_attribute("data-state", "live")
    assert page.evaluate("document.documentElement.scrollWidth") <= page.viewport_size["width"]
    assert violations(page) == {}


def test_the_keyboard_reaches_every_page(service, open_page):
    page = open_page(f"{service.base_url}/#/overview")
    page.get_by_role("link", name="Parameters").focus()
    page.keyboard.press("Enter")
    expect(page.get_by_role("heading", level=1)).to_have_text("Parameters")
    page.keyboard.press("Tab")
    expect(page.get_by_role("link", name="CAN", exact=True).last).to_be_focused()


def test_every_target_on_a_phone_is_large_enough_for_a_finger(service, open_page):
    page = open_page(f"{service.base_url}/#/parameters", "phone")
    expect(page.get_by_test_id("write")).to_be_visible()
    found = {}
    for path, heading in PAGES.items():
        page.goto(f"{service.base_url}/#/{path}")
        expect(page.get_by_role("heading", level=1)).to_have_text(heading)
        small = page.evaluate(
            """[...document.querySelectorAll('.btn, nav a, nav button, input.field, select.field, summary')]
               .filter((e) => e.offsetParent && e.getBoundingClientRect().height < 44)
               .map((e) => e.outerHTML.slice(0, 80))"""
        )
        if small:
            found[path] = small
    assert not found, json.dumps(found, indent=1)


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
