"""What the crew watches: values move, agree with the service, and are never shown as live when they are not."""

import re
from dataclasses import replace

from playwright.sync_api import expect

from app.estimation.cell_model.cell_file import load_cell, save_cell
from app.estimation.cell_model.circuit import CellLimits
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
        re.compile(r"two complete laps|laps? of about|contactors open")
    )

    page.get_by_test_id("cell-30").click()
    expect(page).to_have_url(re.compile(r"#/packs/3/7$"))
    expect(page.get_by_role("heading", level=1)).to_have_text("pack 3, cell 7")
    expect(page.get_by_test_id("cell-voltage")).to_have_text(re.compile(r"^[234]\.\d{4}\sV$"))
    expect(page.get_by_test_id("cell-sentence")).to_have_text(re.compile(r"^.*SOC .*\. R0 .*\. .*usbar joint.*\.$"))
    expect(page.locator("canvas")).to_have_count(7)  # four of the last minutes, three of the trend


COLOURED = """() => [...document.querySelectorAll('[data-last]')]
  .filter((cell) => cell.style.backgroundColor !== '').map((cell) => cell.dataset.testid)"""


def look_at_last_values(page, base_url):
    """Every page that shows cells has them in grey, none of them coloured or marked."""
    for name in ("overview", "packs", "charging"):
        page.goto(f"{base_url}/#/{name}")
        cells = page.locator('[data-testid^="cell-"][data-last]')
        expect(cells).to_have_count(96)
        expect(page.get_by_test_id("cell-30")).to_contain_text(re.compile(r"cell 7: .*\d"))
        expect(page.get_by_test_id("heatmap")).to_contain_text(re.compile(r"\d+ (s|min) ago"))
        assert page.evaluate(COLOURED) == [], name
        expect(page.locator('[data-testid="heatmap"] .cell .mark')).to_have_count(0)
    page.goto(f"{base_url}/#/judge")
    expect(page.locator("[data-testid^=judge-] .v.known")).to_have_count(96)
    expect(page.get_by_test_id("judge-30").locator(".v")).to_have_text(re.compile(r"^[34]\.\d{3}$"))
    expect(page.locator("td.low, td.high, td .hot")).to_have_count(0)
    expect(page.get_by_test_id("age-voltage")).to_have_text(re.compile(r"^\d+ (s|min) ago$"))
    page.goto(f"{base_url}/#/packs/3/7")
    expect(page.get_by_test_id("cell-voltage")).to_have_attribute("data-freshness", "known")
    expect(page.get_by_test_id("cell-voltage")).to_have_text(re.compile(r"^[34]\.\d{4}\sV$"))


def test_cells_of_a_lost_slave_keep_their_last_values_next_to_live_ones(make_service, open_page):
    service = make_service("--seed", "2")
    service.wait_for(lambda s: s["accumulator"]["loaded_cells"] == 96)
    with service.client() as client:
        client.post("/simulator/faults", json={"fault": "slave-lost", "pack": 4}).raise_for_status()
    service.wait_for(lambda s: s["accumulator"]["loaded_cells"] == 84)
    page = open_page(f"{service.base_url}/#/packs")
    lost = page.locator('[data-testid^="cell-"][data-last]')
    for _ in range(2):
        expect(lost).to_have_count(12)
        expect(page.get_by_test_id("cell-40").locator(".text")).to_have_text(re.compile(r"^\d\.\d{3}$"))
        expect(page.get_by_test_id("heatmap")).to_contain_text(re.compile(r"12 of 96 cells, .* ago"))
        expect(page.get_by_role("row", name=re.compile("^Pack 4.*ago"))).to_contain_text(re.compile(r"\d\d\.\d\d V"))
        page.reload()
    page.goto(f"{service.base_url}/#/judge")
    expect(page.locator("[data-testid^=judge-] .v.known")).to_have_count(12)
    expect(page.get_by_test_id("sum")).to_contain_text("≥")  # no sum is made with them
    page.goto(f"{service.base_url}/#/packs/4/5")
    expect(page.get_by_test_id("cell-voltage")).to_have_text(re.compile(r"ago\s\d\.\d{4}\sV$"))


def test_old_values_are_shown_as_old_and_then_as_last_known(make_service, open_page, violations):
    service = make_service("--seed", "2")
    page = open_page(f"{service.base_url}/#/overview")
    expect(page.get_by_test_id("voltage")).to_have_attribute("data-freshness", "live")
    watch(page)
    with service.client() as client:
        client.post("/commands/stream-stop", json={}).raise_for_status()
    expect(page.get_by_test_id("voltage")).to_have_attribute("data-freshness", "stale")
    expect(page.get_by_test_id("age-voltage")).to_contain_text(" old")
    expect(page.get_by_test_id("car-silent")).to_be_visible()
    assert moved(page) == []
    expect(page.get_by_test_id("v-min")).to_have_attribute("data-freshness", "known")
    expect(page.get_by_test_id("v-min")).to_have_text(re.compile(r"^[34]\.\d{4}\sV$"))
    expect(page.get_by_test_id("age-voltage").first).to_have_text(re.compile(r"^\d+ (s|min) ago$"))
    expect(page.get_by_test_id("driver-soc")).to_have_text(re.compile(r"^\d\d\s%$"))  # the master's, over CAN
    for view in (page, open_page(f"{service.base_url}/#/overview", "phone")):
        look_at_last_values(view, service.base_url)
        assert violations(view) == {}
    page.goto(f"{service.base_url}/#/overview")
    page.reload()  # what is known is the service's, not the page's
    expect(page.locator('[data-testid^="cell-"][data-last]')).to_have_count(96)
    with service.client() as client:
        client.post("/commands/stream-start", json={}).raise_for_status()
    expect(page.get_by_test_id("voltage")).to_have_attribute("data-freshness", "live")


def test_a_number_beyond_what_the_cell_file_was_measured_with_is_grey_and_the_reason_is_there(
    make_service, open_page, tmp_path
):
    cell = replace(load_cell(), fit_current_max_a=50.0, limits=CellLimits())
    save_cell(cell, path := tmp_path / "little.toml")
    service = make_service("--seed", "1", "--scenario", "clean-endurance", "--cell", str(path))
    snapshot = service.wait_for(
        lambda s: s["prediction"] and s["prediction"]["power"]["discharge"][0]["reason"] != "relays"
    )
    power, condition = snapshot["prediction"]["power"], snapshot["prediction"]["power_condition"]
    assert all(each["beyond_measured"] and each["measured_a"] <= 50.0 for each in power["discharge"])
    assert condition["code"] == "power-held-beyond"
    page = open_page(f"{service.base_url}/#/overview")
    for horizon in (1, 10, 30):
        shown = page.get_by_test_id(f"power-discharge-{horizon}")
        expect(shown).to_have_class(re.compile(r"\bbeyond\b"))
        expect(shown).to_have_attribute(
            "title", re.compile(r"beyond measured currents: \d+\sA measured for \d+\ss, \d+\sA asked")
        )
    expect(page.get_by_test_id("power-condition")).to_contain_text(
        re.compile("beyond measured currents", re.IGNORECASE)
    )
    expect(page.get_by_test_id("power-charge-1")).not_to_have_class(re.compile(r"\bbeyond\b"))
