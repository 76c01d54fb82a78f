"""Looking back in the browser: laps, report, black box, comparison."""

import re
from zipfile import ZipFile

import numpy as np
import pytest
from playwright.sync_api import expect

from tests.campaign import IS_FULL
from tests.e2e.conftest import COUNT_CLICKS, RULES, SIZES, is_too_wide, spent
from tests.recorded.arrays import SessionMaker
from tests.service_process import NO_CAR

LAP_S = 60.0
TIME_S = np.arange(0.0, 4 * LAP_S, 0.5)
CURRENT_A = np.where(np.sin(TIME_S / LAP_S * 44) + np.sin(TIME_S / LAP_S * 19 + 1) > 0, 120.0, -20.0)
TRIP = {"severity": "trip", "code": "trip-cell-undervoltage", "text": "cell under-voltage", "cell": 30}
PHONE = "phone"
COMPUTED_MS = 90_000  # what a page says of a session is computed when it is first asked for


@pytest.fixture(scope="module")
def looked_back(make_module_service, tmp_path_factory):
    """A service with two finished sessions; in the second a cell trips."""
    data = tmp_path_factory.mktemp("looked-back")
    make = SessionMaker(data / "sessions")
    volts = 3.7 - 0.002 * CURRENT_A[:, None] * np.ones(96)
    markers = [(k * LAP_S, "lap", "") for k in range(4)] + [(-1.0, "driver", "Anna"), (2 * LAP_S, "driver", "Bo")]
    first = make(TIME_S, CURRENT_A, volts, 25, 0.8, markers=markers, metadata={"source": "simulator"}).stem
    low = volts.copy()
    low[(TIME_S > 99) & (TIME_S < 101), 30] = 2.3
    event = TRIP | {"at_s": 100.0, "value": 2.3, "limit": 2.5, "unit": "V"}
    second = make(TIME_S, CURRENT_A, low, 25, 0.8, events=[event], start_s=1.79e9 + 86400).stem
    return make_module_service("--serial", NO_CAR, data=data), first, second


def test_laps_are_compared_corrected_and_kept(looked_back, open_page, tell):
    service, first, _ = looked_back
    page = open_page(f"{service.base_url}/#/sessions")
    page.evaluate(COUNT_CLICKS)
    page.locator(f'a[href="#/sessions/{first}"]').first.click()
    page.get_by_role("link", name="Laps").click()
    rows = page.get_by_test_id("laps").get_by_role("row")
    expect(rows).to_have_count(4)  # three laps under their head
    page.get_by_role("button", name="Lap time").press("Enter")
    expect(page.get_by_role("columnheader", name="Lap time")).to_have_attribute("aria-sort", "ascending")
    expect(page).to_have_url(re.compile("sort-laps=3$"))
    with page.expect_download() as download:
        page.get_by_role("combobox", name="Export lap 2 as").select_option("MoTeC")
    clicks, told = spent(page)
    assert clicks == 3
    tell(f"one lap to MoTeC: {told}")
    assert download.value.suggested_filename == f"{first}-simulated.zip"
    with ZipFile(download.value.path()) as archive:
        assert archive.namelist() == [f"{first}.ld", f"{first}.ldx"]
    expect(page.get_by_test_id("drivers")).to_contain_text("Anna")
    expect(page.get_by_role("img", name=re.compile("^Power"))).to_be_visible()
    expect(page.get_by_test_id("laid-by")).to_contain_text("No speed or position signal recognised")
    page.get_by_test_id("along").fill("i_fs")
    page.get_by_test_id("along").press("Enter")
    expect(page.get_by_test_id("laid-by")).to_contain_text("distance, from i_fs")
    page.get_by_test_id("lap-source").select_option("lap markers")
    expect(page).to_have_url(re.compile("source=markers"))
    page.reload()
    expect(page.get_by_test_id("lap-source")).to_have_value("markers")
    expect(page.get_by_text("3 laps, lap markers")).to_be_visible()
    page.get_by_role("button", name="Correct laps").click()
    page.get_by_role("button", name="Remove lap 1").click()
    page.get_by_role("button", name="Save laps").click()
    expect(rows).to_have_count(3)
    page.reload()
    expect(page.get_by_text("2 laps, corrected manually")).to_be_visible()
    expect(page).not_to_have_url(re.compile("source="))
    page.get_by_role("button", name="Detect again").click()
    expect(rows).to_have_count(4)


def test_a_black_box_has_an_address_and_is_taken_away_as_one_file(looked_back, open_page, tmp_path, tell):
    service, _, second = looked_back
    with service.client() as client:  # makes the box of a session that another program recorded
        assert client.get(f"/sessions/{second}/blackboxes").json()["boxes"]
    page = open_page(f"{service.base_url}/#/sessions")
    page.evaluate(COUNT_CLICKS)
    page.get_by_role("link", name="Black boxes").click()
    page.get_by_test_id("boxes").get_by_role("link", name="cell under-voltage").first.click()
    expect(page.get_by_test_id("box-summary")).to_contain_text("Pack 3, cell 7 was beyond the limit of 2.5\u00a0V")
    clicks, told = spent(page)
    assert clicks == 2
    tell(f"the last trip: {told}")
    page.reload()  # the address is enough
    expect(page.get_by_test_id("box-summary")).to_be_visible()
    with page.expect_download() as download:
        page.get_by_role("link", name="Save as one file").click()
    file = tmp_path / "box.html"
    download.value.save_as(file)
    alone = open_page(file.as_uri())
    alone.context.set_offline(True)
    alone.reload()
    expect(alone.get_by_role("heading", level=1)).to_contain_text("pack 3, cell 7")
    expect(alone.get_by_text("Electronics lead")).to_be_visible()
    expect(alone.locator("figure svg")).to_have_count(3)
    expect(alone.locator("a")).to_have_count(0)  # there is nowhere to go to
    assert pages_of(alone) == 1


def test_a_report_is_printed_from_its_page_and_from_its_file(looked_back, open_page, tmp_path):
    service, _, second = looked_back
    page = open_page(f"{service.base_url}/#/sessions/{second}/report")
    expect(page.get_by_test_id("headline")).to_be_visible()
    curves = page.locator("figure svg").count()
    assert curves == 7
    page.emulate_media(media="print")
    expect(page.get_by_role("heading", level=1)).to_be_visible()
    expect(page.get_by_role("navigation")).to_have_count(0)
    expect(page.get_by_role("button")).to_have_count(0)
    page.emulate_media(media="null")
    with service.client() as client:
        file = tmp_path / "report.html"
        file.write_text(client.get(f"/sessions/{second}/report/page").text, encoding="utf-8")
    alone = open_page(file.as_uri())
    expect(alone.locator("figure svg")).to_have_count(curves)
    drawn_for_a_screen = alone.locator("figure svg").first.get_attribute("width")
    alone.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert alone.locator("figure svg").first.get_attribute("width") == "700" != drawn_for_a_screen
    assert alone.evaluate("document.documentElement.dataset.theme") == "light"
    alone.evaluate("dispatchEvent(new Event('afterprint'))")
    assert alone.locator("figure svg").first.get_attribute("width") == drawn_for_a_screen
    assert pages_of(alone) == pages_of(page) <= 2


def pages_of(page):
    """Print a page and return how many sheets it takes."""
    return len(re.findall(rb"/Type /Page\b", page.pdf(prefer_css_page_size=True)))


def test_a_report_and_a_comparison_are_read(looked_back, open_page):
    service, first, second = looked_back
    page = open_page(f"{service.base_url}/#/sessions/{second}/report")
    expect(page.get_by_test_id("headline")).to_contain_text("kWh discharged")
    expect(page.get_by_text(re.compile("Tripped: cell under-voltage"))).to_be_visible()
    page.get_by_role("link", name="Compare").click()
    page.get_by_test_id("compare-with").select_option(first)
    expect(page.get_by_test_id("comparison")).to_contain_text("Energy out")


ENGLISH = re.compile(r"\b(the|and|of|cell|lowest|limit|allowed|seen|when|where|charge|session|time)\b", re.IGNORECASE)


def test_a_document_speaks_the_language_of_the_page(looked_back, open_page):
    service, _, second = looked_back
    with service.client() as client:
        box = client.get(f"/sessions/{second}/blackboxes").json()["boxes"][0]["id"]
    page = open_page(f"{service.base_url}/#/system")
    page.get_by_role("button", name="Norsk").click()
    for path, title in ((f"sessions/{second}/report", "Rapport for"), (f"sessions/box/{box}", "Ferdsskriver")):
        page.goto(f"{service.base_url}/#/{path}")
        address = page.get_by_role("link", name="Lagre som én fil").get_attribute("href")
        document = open_page(f"{service.base_url}{address}")
        expect(document).to_have_title(re.compile(title))
        expect(document.locator("html")).to_have_attribute("lang", "nb")
        body = document.locator("body").inner_text()
        # an event without a message stays as recorded, and a code is the same in every language
        body = re.sub(f"{TRIP['text']}|{TRIP['code']}", "", body, flags=re.IGNORECASE)
        assert [line for line in body.splitlines() if ENGLISH.search(line)] == [], ENGLISH.findall(body)


@pytest.mark.timeout(300)  # nine pages: minutes on a machine with forty other things to do
def test_no_page_of_a_session_has_an_accessibility_violation_or_is_too_wide(looked_back, open_page, violations):
    """In `make test` in the dark theme on a desktop, in `make campaign` in all themes and on a phone."""
    service, first, second = looked_back
    with service.client() as client:
        box = client.get(f"/sessions/{second}/blackboxes").json()["boxes"][0]["id"]
    places = {
        f"sessions/{second}": page_has("canvas"),
        f"sessions/{first}/laps": page_has('[data-testid="laps"]'),
        f"sessions/{second}/report": page_has('[data-testid="headline"]'),
        f"sessions/{second}/boxes": page_has('[data-testid="boxes"]'),
        f"sessions/box/{box}": page_has('[data-testid="box-summary"]'),
        f"sessions/{second}/compare/{first}": page_has('[data-testid="comparison"]'),
        f"sessions/{second}/export": page_has("main h1"),
        "sessions/boxes": page_has('[data-testid="boxes"]'),
        "sessions/import": page_has("main h1"),
    }
    page = open_page(f"{service.base_url}/#/sessions")
    themes = RULES if IS_FULL else ("dark",)
    found = {}
    for path, shown in places.items():
        page.set_viewport_size(SIZES["desktop"])
        page.goto(f"{service.base_url}/#/{path}")
        shown(page)
        found |= {f"{path}, {rule}": where for rule, where in violations(page, themes=themes).items()}
        for size in ("desktop", PHONE):
            page.set_viewport_size(SIZES[size])
            assert not is_too_wide(page), (path, size)
        if IS_FULL:
            on_phone = violations(page)
            found |= {f"{path}, phone, {rule}": where for rule, where in on_phone.items()}
    assert found == {}


def page_has(selector):
    """Wait until a page shows what it is for."""
    return lambda page: expect(page.locator(selector).first).to_be_visible(timeout=COMPUTED_MS)
