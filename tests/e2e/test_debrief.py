"""Looking back in the browser: laps, report, black box, comparison, passports."""

import re

import numpy as np
import pytest
from playwright.sync_api import expect

from tests.recorded.arrays import SessionMaker

LAP_S = 60.0
TIME_S = np.arange(0.0, 4 * LAP_S, 0.5)
CURRENT_A = np.where(np.sin(TIME_S / LAP_S * 44) + np.sin(TIME_S / LAP_S * 19 + 1) > 0, 120.0, -20.0)
TRIP = {"severity": "trip", "code": "trip-v-min", "text": "cell under-voltage", "cell": 30}
PHONE = "phone"


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
    return make_module_service("--seed", "4", "--no-record", data=data), first, second


def test_laps_are_compared_corrected_and_kept(looked_back, open_page):
    service, first, _ = looked_back
    page = open_page(f"{service.base_url}/#/sessions/{first}/laps")
    rows = page.get_by_test_id("laps").get_by_role("row")
    expect(rows).to_have_count(4)  # three laps under their head
    expect(page.get_by_test_id("drivers")).to_contain_text("Anna")
    expect(page.get_by_role("img", name=re.compile("^Power"))).to_be_visible()
    page.get_by_role("button", name="Correct the laps").click()
    page.get_by_role("button", name="Remove lap 1").click()
    page.get_by_role("button", name="Keep in the session").click()
    expect(rows).to_have_count(3)
    page.reload()
    expect(page.get_by_text("2 laps, as settled")).to_be_visible()
    page.get_by_role("button", name="Find them again").click()
    expect(rows).to_have_count(4)


def test_a_black_box_has_an_address_and_a_page_to_print(looked_back, open_page):
    service, _, second = looked_back
    page = open_page(f"{service.base_url}/#/sessions/{second}/boxes")
    page.get_by_test_id("boxes").get_by_role("link", name="cell under-voltage").click()
    expect(page.get_by_test_id("box-summary")).to_contain_text("Pack 3, cell 7 was beyond the limit of 2.5 V")
    page.reload()  # the address is enough
    expect(page.get_by_test_id("box-summary")).to_be_visible()
    with page.context.expect_page() as opened:
        page.get_by_role("link", name="Page to print").click()
    expect(opened.value.get_by_role("heading", level=1)).to_contain_text("pack 3, cell 7")
    expect(opened.value.locator("svg")).to_have_count(3)


def test_a_report_and_a_comparison_are_read(looked_back, open_page):
    service, first, second = looked_back
    page = open_page(f"{service.base_url}/#/sessions/{second}/report")
    expect(page.get_by_test_id("headline")).to_contain_text("kWh out")
    expect(page.get_by_text("Tripped: cell under-voltage")).to_be_visible()
    page.get_by_role("link", name="Compare").click()
    page.get_by_test_id("compare-with").select_option(first)
    expect(page.get_by_test_id("comparison")).to_contain_text("Energy out")


ENGLISH = re.compile(r"\b(the|and|of|cell|lowest|limit|allowed|seen|when|where|charge|session|time)\b", re.IGNORECASE)


def test_what_is_printed_speaks_the_language_of_the_page(looked_back, open_page):
    service, _, second = looked_back
    with service.client() as client:
        box = client.get(f"/sessions/{second}/blackboxes").json()["boxes"][0]["id"]
    page = open_page(f"{service.base_url}/#/system")
    page.get_by_role("button", name="Norsk").click()
    for path, link, title in (
        (f"sessions/{second}/report", "Rapport til utskrift", "Rapport for"),
        (f"sessions/box/{box}", "Side til utskrift", "Svart boks"),
    ):
        page.goto(f"{service.base_url}/#/{path}")
        with page.context.expect_page() as opened:
            page.get_by_role("link", name=link).click()
        printed = opened.value
        expect(printed).to_have_title(re.compile(title))
        expect(printed.locator("html")).to_have_attribute("lang", "nb")
        body = printed.locator("body").inner_text()
        assert [line for line in body.splitlines() if ENGLISH.search(line)] == [], ENGLISH.findall(body)


def test_a_swap_is_recorded_on_a_phone(looked_back, open_page):
    service, _, _ = looked_back
    page = open_page(f"{service.base_url}/#/sessions/passport/30", PHONE)
    expect(page.get_by_test_id("passport-state")).to_contain_text("1 sessions read")
    page.get_by_role("textbox", name="Note").fill("spare 4")
    page.get_by_test_id("swap").click()
    expect(page.get_by_text("spare 4")).to_be_visible()
    expect(page.get_by_test_id("passport-history").get_by_role("row")).to_have_count(2)


@pytest.mark.parametrize("size", ["desktop", PHONE])
def test_no_page_of_a_session_has_an_accessibility_violation(looked_back, open_page, violations, size):
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
        f"sessions/{second}/take": page_has("main h1"),
        "sessions/boxes": page_has('[data-testid="boxes"]'),
        "sessions/passport": page_has('[data-testid="passport-state"]'),
        "sessions/passport/30": page_has('[data-testid="passport-history"]'),
        "sessions/bring": page_has("main h1"),
    }
    page = open_page(f"{service.base_url}/#/sessions", size)
    found = {}
    for path, shown in places.items():
        page.goto(f"{service.base_url}/#/{path}")
        shown(page)
        assert page.evaluate("document.documentElement.scrollWidth") <= page.viewport_size["width"], path
        found |= {f"{path}, {rule}": where for rule, where in violations(page).items()}
    assert found == {}


def page_has(selector):
    """Wait until a page shows what it is for."""
    return lambda page: expect(page.locator(selector).first).to_be_visible()
