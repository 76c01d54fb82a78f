"""What a crew sees without scrolling, and that a large screen is used."""

import re

from playwright.sync_api import expect

READS_ONLY = True

MIDDLES = """cards => {
  const middle = ({top, bottom}) => (top + bottom) / 2;
  const rows = ([card, row]) => [...document.querySelectorAll(`[aria-label=${card}] ${row}`)];
  return cards.map((card) => rows(card).map((e) => middle(e.getBoundingClientRect())));
}"""  # rows of cards, all at one instant: a notice above may come and go


def box(locator) -> dict[str, float]:
    expect(locator).to_be_visible()
    found = locator.bounding_box()
    assert found is not None
    return found


def test_a_television_is_used_to_its_edge(service, open_page):
    page = open_page(f"{service.base_url}/#/overview", "television")
    for path, title in (("overview", "Overview"), ("packs", "Packs"), ("sessions", "Sessions")):
        page.goto(f"{service.base_url}/#/{path}")
        expect(page.get_by_role("heading", level=1)).to_have_text(title)
        expect(page.locator("main .page > *").nth(1)).to_be_visible()
        right = page.evaluate(
            "Math.max(...[...document.querySelectorAll('.page > *')].map(e => e.getBoundingClientRect().right))"
        )
        assert right > 2500, path


def test_alarms_are_seen_at_once_and_rows_are_read_across(service, open_page):
    page = open_page(f"{service.base_url}/#/overview")
    alarms = box(page.get_by_role("region", name="Alarms"))
    assert alarms["y"] + alarms["height"] < 900
    cells_map = box(page.get_by_role("region", name="Cells in the car"))
    assert cells_map["y"] + cells_map["height"] < 900
    electrical = page.get_by_role("region", name="Accumulator").locator("dt")
    cells = page.get_by_role("region", name="Extremes").locator("th")
    expect(electrical).to_have_count(5)
    expect(cells).to_have_count(6)  # the coldest stands alone
    left, right = page.evaluate(MIDDLES, [["Accumulator", "dt"], ["Extremes", "th"]])
    assert all(abs(one - other) <= 2 for one, other in zip(left, right[:5], strict=True)), (left, right)

    expect(page.get_by_test_id("power-discharge-1")).to_contain_text("kW")
    expect(page.locator(".charts canvas")).to_have_count(3)
    page.set_viewport_size({"width": 1024, "height": 768})
    for mark in ("highest", "lowest", "missing", "balancing"):
        expect(page.locator(".legend .key", has_text=mark)).to_be_visible()
    assert len(re.findall(rb"/Type /Page\b", page.pdf(prefer_css_page_size=True))) == 1, "pages on paper"

    page.goto(f"{service.base_url}/#/judge")  # an official is told the time, the battery and the age
    expect(page.get_by_test_id("judge-clock")).to_contain_text(":")
    expect(page.get_by_test_id("judge-oldest")).to_contain_text(" s")
    expect(page.get_by_test_id("judge-battery")).to_contain_text("96 cells")
    page.set_viewport_size({"width": 1440, "height": 900})
    assert page.locator(".judge > header").bounding_box()["height"] < 60, "one line"
