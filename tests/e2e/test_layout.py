"""What a crew sees without scrolling, and that a large screen is used."""

from playwright.sync_api import expect

READS_ONLY = True


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


def test_alarms_are_seen_without_scrolling_and_rows_of_neighbouring_cards_are_read_across(service, open_page):
    page = open_page(f"{service.base_url}/#/overview")
    alarms = box(page.get_by_role("region", name="Alarms"))
    assert alarms["y"] + alarms["height"] < 900
    electrical = page.get_by_role("region", name="Accumulator").locator("dt")
    cells = page.get_by_role("region", name="Extremes").locator("th")
    expect(electrical).to_have_count(5)
    expect(cells).to_have_count(5)
    for k in range(5):
        left, right = box(electrical.nth(k)), box(cells.nth(k))
        assert abs(left["y"] + left["height"] / 2 - right["y"] - right["height"] / 2) <= 2

    page.goto(f"{service.base_url}/#/judge")  # an official is told the time, the battery and the age
    expect(page.get_by_test_id("judge-clock")).to_contain_text(":")
    expect(page.get_by_test_id("judge-oldest")).to_contain_text(" s")
    expect(page.get_by_test_id("judge-battery")).to_contain_text("96 cells")
