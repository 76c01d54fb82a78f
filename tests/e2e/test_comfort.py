"""What makes the pages bearable for a day: keys, sound, a layout that stays, a page that opens without the service."""

import re

from playwright.sync_api import expect

from tests.e2e.conftest import COUNT_CLICKS, spent

READS_ONLY = True

LINES_OF_WORDS = """(cell) => Math.max(...[...cell.childNodes].filter((n) => n.data?.trim()).map((n) => {
  const range = document.createRange();
  range.selectNodeContents(n);
  return range.getClientRects().length;
}))"""


def test_single_keys_act_and_can_be_switched_off(service, open_page, tell):
    page = open_page(f"{service.base_url}/#/overview")
    expect(page.get_by_test_id("heatmap")).to_be_visible()
    page.evaluate(COUNT_CLICKS)
    page.get_by_role("row", name="Lowest now").get_by_role("link").click()  # the weakest cell, and why
    expect(page.get_by_test_id("cell-sentence")).to_contain_text("joint")
    clicks, told = spent(page)
    assert clicks == 1
    tell(f"the weakest cell, and why: {told}")
    page.keyboard.press("2")
    expect(page.get_by_role("heading", level=1)).to_have_text("Packs")
    page.keyboard.press("]")
    expect(page.get_by_role("heading", level=1)).to_have_text("pack 1, cell 1")
    page.keyboard.press("?")
    expect(page.get_by_test_id("keys")).to_be_visible()
    page.get_by_label("Enable single-key shortcuts").uncheck()
    page.keyboard.press("Escape")
    page.keyboard.press("1")
    expect(page.get_by_role("heading", level=1)).to_have_text("pack 1, cell 1")


def test_a_key_typed_into_a_field_does_nothing_else_and_a_muted_sound_stays_so(service, open_page):
    page = open_page(f"{service.base_url}/#/events")
    page.get_by_label("Filter by text").fill("")
    page.get_by_label("Filter by text").press("1")
    expect(page.get_by_role("heading", level=1)).to_have_text("Events")
    expect(page.get_by_label("Filter by text")).to_have_value("1")

    expect(page.get_by_test_id("sound-state")).to_have_text("Sound on")
    page.get_by_role("button", name="Mute 30 min").click()
    expect(page.get_by_test_id("sound-state")).to_contain_text("Muted until")
    page.reload()
    expect(page.get_by_test_id("sound-state")).to_contain_text("Muted until")
    page.get_by_test_id("sound").get_by_role("button", name="Unmute").click()
    expect(page.get_by_test_id("sound-state")).to_have_text("Sound on")


def test_the_layout_is_as_it_was_left_and_arrows_walk_the_map_as_the_car_is_built(service, open_page):
    page = open_page(f"{service.base_url}/#/packs")
    page.get_by_test_id("metric-temperature").click()
    page.get_by_label("Lock colour scale").check()
    page.reload()
    expect(page.get_by_test_id("metric-temperature")).to_have_attribute("aria-pressed", "true")
    expect(page.get_by_label("Lock colour scale")).to_be_checked()

    page.get_by_test_id("cell-0").focus()
    page.keyboard.press("ArrowDown")
    expect(page.get_by_test_id("cell-11")).to_be_focused()
    page.keyboard.press("ArrowDown")
    expect(page.get_by_test_id("cell-84")).to_be_focused()
    page.keyboard.press("Enter")
    expect(page.get_by_role("heading", level=1)).to_have_text("pack 8, cell 1")


def test_a_link_shows_the_same_part_of_the_live_charts_the_same_span_and_the_same_map(service, open_page):
    page = open_page(f"{service.base_url}/#/overview")
    page.get_by_role("button", name="15 min").click()
    page.get_by_role("combobox", name="Show").select_option("temperature")
    chart = page.locator(".charts .u-over").first
    chart.hover()
    place = chart.bounding_box()
    page.mouse.move(place["x"] + 0.6 * place["width"], place["y"] + 20)
    page.mouse.down()
    page.mouse.move(place["x"] + 0.9 * place["width"], place["y"] + 20, steps=3)
    page.mouse.up()
    expect(page.get_by_role("button", name="Full range")).to_have_count(3)
    expect(page).to_have_url(re.compile(r"from-live=\d+\.\d+&to-live=\d+\.\d+"))
    again = open_page(page.url)
    expect(again.get_by_role("button", name="15 min")).to_have_attribute("aria-pressed", "true")
    expect(again.get_by_test_id("heatmap")).to_have_attribute("data-metric", "temperature")
    expect(again.get_by_role("button", name="Full range")).to_have_count(3)
    again.get_by_role("button", name="Full range").first.click()
    expect(again).not_to_have_url(re.compile("live"))
    expect(again.get_by_role("button", name="Full range")).to_have_count(0)


def test_who_reads_and_where_phones_reach_it_is_told(service, open_page):
    page = open_page(f"{service.base_url}/#/system")
    expect(page.get_by_test_id("readers")).to_contain_text("engineer, 127.0.0.1")
    expect(page.get_by_test_id("disk")).to_contain_text("of")
    expect(page.get_by_test_id("reach-needs")).to_contain_text("Password: missing")
    expect(page.get_by_test_id("phones-on")).to_be_disabled()
    source = page.get_by_test_id("links").get_by_role("row", name="Source").get_by_role("cell").first
    expect(source).to_contain_text(re.compile("[/:]"))
    assert source.evaluate(LINES_OF_WORDS) == 1  # the address breaks between its parts


def test_pages_open_without_the_service_and_show_no_value(make_service, open_page):
    service = make_service()
    page = open_page(f"{service.base_url}/#/overview", quiet=False, service_worker=True)
    expect(page.get_by_test_id("link-rs232")).to_have_attribute("data-state", "live")
    page.evaluate("navigator.serviceWorker.ready")
    page.reload()
    expect(page.get_by_test_id("link-rs232")).to_have_attribute("data-state", "live")
    kept = page.evaluate(
        """async () => (await Promise.all((await caches.keys()).map(async (name) =>
           (await (await caches.open(name)).keys()).map((r) => new URL(r.url).pathname)))).flat()"""
    )
    assert "/index.html" in kept
    assert not [path for path in kept if path.startswith("/api/")]
    service.stop()
    page.reload()
    expect(page.get_by_test_id("service-lost")).to_be_visible()
    expect(page.get_by_test_id("voltage")).to_contain_text("–")
    page.goto(f"{service.base_url}/#/help")
    expect(page.get_by_role("heading", level=1)).to_have_text("Help")
