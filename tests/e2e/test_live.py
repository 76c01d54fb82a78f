"""What the crew watches: values move, agree with the service, and are never shown as live when they are not."""

import re

from playwright.sync_api import expect

from tests.e2e.stillness import moved, watch

READS_ONLY = True


def test_all_cells_are_shown_and_move_and_every_metric_can_be_shown(service, open_page):
    page = open_page(f"{service.base_url}/#/packs", full_rate=True)
    cells = page.locator('[data-testid^="cell-"]')
    expect(cells).to_have_count(96)
    expect(page.locator('[data-testid^="cell-"][data-missing]')).to_have_count(0)
    before = cells.all_inner_texts()
    page.wait_for_function(
        """(old) => [...document.querySelectorAll('[data-testid^=cell-]')]
           .filter((e, i) => e.innerText !== old[i]).length > 48""",
        arg=before,
    )
    numbers = ("deviation", "temperature", "soc", "sigma", "resistance", "joint", "capacity", "health", "voltage")
    for metric in (*numbers, "balancing"):
        page.get_by_test_id(f"metric-{metric}").click()
        expect(page.get_by_test_id("heatmap")).to_have_attribute("data-metric", metric)
        if metric not in ("joint", "health"):  # they need a drive first
            expect(page.locator('[data-testid^="cell-"][data-missing]')).to_have_count(0)


def test_the_overview_shows_what_the_service_says_what_lies_ahead_and_leads_to_a_cell(service, open_page):
    page = open_page(f"{service.base_url}/#/overview")
    expect(page.get_by_test_id("voltage")).to_have_text(re.compile(r"^\d{3}\.\d\sV$"))
    expect(page.get_by_test_id("driver-soc")).to_be_visible()  # a range until 3 sigma are within 10 points
    with service.client() as client:
        snapshot = client.get("/snapshot").json()
    shown = int(page.get_by_test_id("driver-soc").inner_text().split()[0])
    assert abs(shown - snapshot["accumulator"]["driver_soc_percent"]) <= 1
    expect(page.get_by_test_id("loaded-cells")).to_contain_text("96")
    lowest = page.get_by_role("region", name="Extremes").get_by_role("link").nth(1)
    expect(lowest).to_have_text(re.compile(r"^pack [1-8], cell ([1-9]|1[0-2])$"))

    for direction in ("discharge", "charge"):
        for horizon in (1, 10, 30):
            value = page.get_by_test_id(f"power-{direction}-{horizon}")
            expect(value).to_have_text(re.compile(r"^\d+\.\d\skW$"))
    expect(page.get_by_test_id("nearest")).to_have_text(re.compile(r"^(> 1 h|\d.* (s|min))$"))
    expect(page.get_by_test_id("energy-left")).to_have_text(re.compile(r"^\d\.\d\d\skWh$"))
    expect(page.get_by_test_id("laps-condition")).to_have_text(
        re.compile(r"two whole laps|laps of about|relays are open")
    )

    page.get_by_test_id("cell-30").click()
    expect(page).to_have_url(re.compile(r"#/packs/3/7$"))
    expect(page.get_by_role("heading", level=1)).to_have_text("pack 3, cell 7")
    expect(page.get_by_test_id("cell-voltage")).to_have_text(re.compile(r"^[234]\.\d{4}\sV$"))
    expect(page.get_by_test_id("cell-sentence")).to_have_text(re.compile(r"^.*SOC .*; R0 .*; its joint .*\.$"))
    expect(page.locator("canvas")).to_have_count(7)  # four of the last minutes, three of the trend


def test_old_values_are_shown_as_old_and_then_not_at_all(make_service, open_page):
    service = make_service("--seed", "2")
    page = open_page(f"{service.base_url}/#/overview")
    expect(page.get_by_test_id("voltage")).to_have_attribute("data-freshness", "live")
    watch(page)
    with service.client() as client:
        client.post("/commands/stream-stop", json={}).raise_for_status()
    expect(page.get_by_test_id("voltage")).to_have_attribute("data-freshness", "stale")
    expect(page.get_by_test_id("age-voltage")).to_contain_text("stale")
    expect(page.get_by_test_id("car-silent")).to_be_visible()
    assert moved(page) == []
    expect(page.get_by_test_id("voltage")).to_have_attribute("data-freshness", "blank")
    expect(page.get_by_test_id("voltage")).to_have_text(re.compile("^–"))
    expect(page.locator('[data-testid^="cell-"][data-missing]')).to_have_count(96)
    expect(page.get_by_test_id("age-voltage")).to_contain_text("none since")
    with service.client() as client:
        client.post("/commands/stream-start", json={}).raise_for_status()
    expect(page.get_by_test_id("voltage")).to_have_attribute("data-freshness", "live")
