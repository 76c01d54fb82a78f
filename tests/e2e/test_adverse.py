"""What a pit brings: a dead link, a restarted service, two tabs, a wrong clock, the back button."""

import re

from playwright.sync_api import expect

READS_ONLY = True

HOUR_AHEAD = """
const Real = Date;
window.Date = class extends Real {
  constructor(...given) { given.length ? super(...given) : super(Real.now() + 3600e3); }
  static now() { return Real.now() + 3600e3; }
};
"""


def test_a_dead_rs232_link_is_told_while_can_goes_on(make_service, open_page):
    service = make_service("--seed", "11")
    service.wait_for(lambda s: s["accumulator"]["loaded_cells"] == 96 and s["links"]["can"]["state"] == "live")
    page = open_page(f"{service.base_url}/#/overview", "phone")
    with service.client() as client:
        client.post("/simulator/unplug", json={"for_s": 15}).raise_for_status()
    expect(page.get_by_test_id("link-rs232")).not_to_have_attribute("data-state", "live")
    expect(page.get_by_test_id("link-can")).to_have_attribute("data-state", "live")
    # not every alarm of RS232: on a busy computer what arrives is late, and that is told, too
    alarm = page.get_by_test_id("alarm").filter(has_text="RS232 lost")
    expect(alarm).to_be_visible()
    expect(page.get_by_test_id("cell-30")).to_have_attribute("data-missing", "")  # CAN carries no single cells
    expect(page.get_by_test_id("link-rs232")).to_have_attribute("data-state", "live", timeout=30_000)
    expect(page.get_by_test_id("cell-30")).not_to_have_attribute("data-missing", "")
    expect(alarm).to_contain_text("cleared")  # told until somebody has seen it
    alarm.get_by_role("button", name="Acknowledge").click()
    expect(alarm).to_have_count(0)


def test_what_is_seen_in_one_tab_is_seen_in_the_other(make_service, open_page):
    service = make_service("--seed", "12")
    service.wait_for(lambda s: s["accumulator"]["loaded_cells"] == 96)
    one, other = (open_page(f"{service.base_url}/#/events", size) for size in ("desktop", "phone"))
    with service.client() as client:
        client.post("/simulator/faults", json={"fault": "sense-wire-open", "pack": 3, "cell": 7}).raise_for_status()
    for page in (one, other):
        expect(page.get_by_test_id("alarms")).to_contain_text("trip")
    # a loose wire floats between two cells: which of them trips first, and by which limit, is chance
    expect(one.get_by_test_id("trip-banner")).to_contain_text("shutdown circuit open")
    expect(one.get_by_test_id("trip-cell")).to_have_text(re.compile("^pack 3, cell [78]$"))
    expect(one).to_have_title(re.compile(r"^\d trip"))
    button = one.get_by_role("button", name=re.compile("^Acknowledge: shutdown circuit open"))
    button.click()
    expect(button).to_have_count(0)
    expect(other.get_by_role("button", name=re.compile("^Acknowledge: shutdown circuit open"))).to_have_count(0)
    expect(other.get_by_test_id("alarm").filter(has_text="acknowledged by engineer")).to_be_visible()


def test_a_restarted_service_finds_the_reader_where_he_was(make_service, open_page):
    service = make_service("--seed", "13")
    service.wait_for(lambda s: s["accumulator"]["loaded_cells"] == 96)
    port = service.base_url.rsplit(":", 1)[1]
    page = open_page(f"{service.base_url}/#/packs/3/7", quiet=False)
    expect(page.get_by_test_id("cell-voltage")).to_have_attribute("data-freshness", "live")
    service.kill()
    expect(page.get_by_test_id("service-lost")).to_be_visible()
    expect(page.get_by_test_id("link-rs232")).to_have_attribute("data-state", "unknown")
    expect(page.get_by_test_id("state")).to_have_attribute("data-state", "unknown")
    expect(page.get_by_test_id("cell-voltage")).to_have_attribute("data-freshness", "known")
    service.arguments += ["--port", port]
    service.start()
    expect(page.get_by_test_id("cell-voltage")).to_have_attribute("data-freshness", "live")
    expect(page.get_by_test_id("service-lost")).to_be_hidden()
    expect(page.get_by_role("heading", level=1)).to_have_text("pack 3, cell 7")


def test_a_browser_an_hour_ahead_shows_the_services_time(service, open_page):
    page = open_page(f"{service.base_url}/#/packs/3/7")
    page.context.add_init_script(HOUR_AHEAD)
    page.reload()
    expect(page.get_by_test_id("cell-voltage")).to_have_attribute("data-freshness", "live")
    page.goto(f"{service.base_url}/#/system")
    expect(page.get_by_test_id("warnings")).to_contain_text(
        re.compile(r"clock and this device differ by −3(599|600) s")
    )
    page.goto(f"{service.base_url}/#/overview")
    expect(page.get_by_role("img", name=re.compile("^Current over time")).locator("canvas")).to_be_visible()
    expect(page.get_by_text("no data in this range")).to_have_count(0)  # the charts' window is the service's


def test_back_leads_back(service, open_page):
    page = open_page(f"{service.base_url}/#/overview")
    page.get_by_test_id("cell-30").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("pack 3, cell 7")
    page.get_by_role("link", name="Next", exact=True).click()
    expect(page.get_by_role("heading", level=1)).to_have_text("pack 3, cell 8")
    page.go_back()
    expect(page.get_by_role("heading", level=1)).to_have_text("pack 3, cell 7")
    page.go_back()
    expect(page.get_by_test_id("voltage")).to_be_visible()
    page.go_forward()
    expect(page.get_by_role("heading", level=1)).to_have_text("pack 3, cell 7")
