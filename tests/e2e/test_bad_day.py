"""The bad day: a trip is on every page, a service that stands is told, and a frame shows one instant, also then."""

import os
import re
import signal
from contextlib import contextmanager

import pytest
from playwright.sync_api import expect

TRIPPED = 63  # pack 6, cell 4
ALL_BELOW_THE_BANNER = """() => {  // every row of voltages is read without scrolling
  const box = (selector) => document.querySelector(selector).getBoundingClientRect();
  const first = box('[data-testid="judge-0"] .v'), last = box('[data-testid="judge-95"] .v');
  return box('[data-testid="trip-banner"]').bottom <= first.top && last.bottom <= box('main').bottom;
}"""
COVERS_THE_PAGE = """() => document.querySelector('[data-testid="trip-banner"]').getBoundingClientRect().bottom
  > document.querySelector('main').getBoundingClientRect().top"""
PAGES = ("overview", "packs", "packs/6/4", "charging", "parameters", "can", "sessions", "events", "system", "judge")
FRAMES = 60  # screen frames: a second, in which 28 snapshots come

# Compares within single animation frames what a page says of one cell in several places.
COMPARE = """async ([page, frames, instants]) => {
  const number = (text) => (text.match(/\\d+\\.\\d+/) ?? [''])[0];
  const all = (selector) => [...document.querySelectorAll(selector)];
  const texts = (selector) => all(selector).map((e) => number(e.textContent));
  const one = (id) => number(document.querySelector(`[data-testid="${id}"]`).textContent);
  const three = (text) => (text === '' ? '' : Number(text).toFixed(3));
  const pairs = {
    overview: () => {  // the card's extremes and the map
      const map = texts('[data-testid^="cell-"] .text').filter(Boolean).map(Number);
      return [[three(one('v-min')), Math.min(...map).toFixed(3)], [three(one('v-max')), Math.max(...map).toFixed(3)]];
    },
    packs: () => all('[id^="pack-"]').flatMap((pack) => {  // the map and the table of packs
      const map = [...pack.querySelectorAll('.cell .text')].map((e) => number(e.textContent)).filter(Boolean);
      const row = all('tbody tr').find((tr) => tr.textContent.trim().startsWith(`Pack ${pack.id.slice(5)}`));
      const cells = [...row.querySelectorAll('td')].map((td) => number(td.textContent));
      const ends = [Math.min(...map.map(Number)), Math.max(...map.map(Number))].map((v) => v.toFixed(3));
      return [[three(cells[2]), ends[0]], [three(cells[3]), ends[1]]];
    }),
    judge: () => {  // the card in the head and the table
      const table = texts('[data-testid="judge"] .v').filter(Boolean).map(Number);
      const head = all('header dd').map((e) => number(e.textContent));
      return [[head[2], Math.min(...table).toFixed(3)], [head[3], Math.max(...table).toFixed(3)]];
    },
  }[page];
  const differ = [];
  const seen = new Set();
  for (let i = 0; i < frames || (seen.size < instants && i < 20 * frames); i++) {
    await new Promise(requestAnimationFrame);
    const found = pairs();
    seen.add(found.join(';'));
    differ.push(...found.filter(([a, b]) => a !== b || a === ''));
  }
  return { differ, seen: seen.size };
}"""


def compare(page, base_url, instants=2):
    """Look at a second of frames of each page that shows a cell in two ways; a car at rest may not change."""
    for name in ("overview", "packs", "judge"):
        page.goto(f"{base_url}/#/{name}")
        expect(page.locator('[data-testid="judge-0"], [data-testid="cell-0"]').first).to_contain_text(
            re.compile(r"\d\.\d{3}")
        )
        found = page.evaluate(COMPARE, [name, FRAMES, instants])
        assert found["differ"] == [], name
        assert found["seen"] >= instants, name


@contextmanager
def stopped(service):
    """The service stands: its process has no processor, its sockets stay open."""
    os.kill(service.process.pid, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(service.process.pid, signal.SIGCONT)


def test_one_frame_shows_one_instant(service, open_page):
    compare(open_page(f"{service.base_url}/#/overview", "television", full_rate=True), service.base_url)


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="no process can be stopped here")
def test_a_service_that_stands_is_told_and_what_cannot_work_is_off(service, open_page):
    page = open_page(f"{service.base_url}/#/simulator", quiet=False)
    expect(page.get_by_test_id("inject")).to_be_enabled()
    for name, ready in (("charging", "to-full"), ("parameters", "store"), ("system", "disk")):
        page.goto(f"{service.base_url}/#/{name}")
        expect(page.get_by_test_id(ready)).to_be_visible()
    with stopped(service):
        expect(page.get_by_test_id("service-lost")).to_be_visible()
        expect(page.get_by_test_id("warnings")).to_contain_text("data quality unknown")
        expect(page.locator('[data-testid="plausibility"] [data-verdict="true"]')).to_have_count(0)
        expect(page.get_by_test_id("command-reset")).to_be_disabled()
        for link in ("rs232", "can"):
            expect(page.get_by_test_id(f"link-{link}")).to_have_attribute("data-state", "unknown")
        page.goto(f"{service.base_url}/#/charging")
        expect(page.get_by_test_id("command-charge-start")).to_be_disabled()
        expect(page.get_by_test_id("why-not")).to_contain_text("does not respond")
        page.goto(f"{service.base_url}/#/parameters")
        expect(page.get_by_test_id("store")).to_be_disabled()
    expect(page.get_by_test_id("service-lost")).to_be_hidden()
    page.goto(f"{service.base_url}/#/simulator")
    expect(page.get_by_test_id("inject")).to_be_enabled()


def test_a_trip_is_on_every_page_and_its_cell_is_marked_on_every_map(service, open_page, violations):
    page = open_page(f"{service.base_url}/#/overview", "television")
    phone = open_page(f"{service.base_url}/#/overview", "phone")
    with service.client() as client:
        fault = {"fault": "cell-voltage-stuck", "pack": 6, "cell": 4, "value": 4.4}
        client.post("/simulator/faults", json=fault).raise_for_status()
    for view in (page, phone):
        expect(view.get_by_test_id("trip-banner")).to_contain_text(
            "Shutdown circuit open: cell overvoltage", ignore_case=True
        )
        expect(view.get_by_test_id("trip-banner")).to_contain_text(
            re.compile(r"4\.\d+ V, limit 4\.2000 V.*since", re.I)
        )
    expect(page.get_by_test_id("ahead")).to_contain_text("Contactors open: no power")
    expect(page.get_by_test_id("power-discharge-1")).to_have_count(0)
    for name in PAGES:
        for view in (page, phone):
            view.goto(f"{service.base_url}/#/{name}")
            expect(view.get_by_test_id("trip-cell")).to_have_text("pack 6, cell 4")
            expect(view.get_by_test_id("trip-cell")).to_be_in_viewport()
            expect(view.get_by_test_id("trip-box")).to_be_in_viewport()
            expect(view).to_have_title(re.compile(r"trip.* Simulated"))
            assert view.evaluate(COVERS_THE_PAGE) is False, name
            if name in ("overview", "packs", "charging"):
                expect(view.get_by_test_id(f"cell-{TRIPPED}")).to_contain_text("tripped")
            if name == "judge":
                expect(view.get_by_test_id(f"judge-{TRIPPED}")).to_contain_text("tripped")
            assert view.evaluate("document.documentElement.scrollWidth") <= view.viewport_size["width"], name
    assert violations(page) == {}
    compare(page, service.base_url, instants=1)  # the last is the judge's
    for width, height in ((1440, 900), (1280, 720)):
        page.set_viewport_size({"width": width, "height": height})
        page.wait_for_function(ALL_BELOW_THE_BANNER)
    expect(page.get_by_test_id("trip-box")).to_have_attribute("href", re.compile("^#/sessions/box/."))
    expect(page.get_by_test_id("trip-cause")).to_contain_text(re.compile(r"Likely cause.+\d\s%"))
    page.get_by_test_id("trip-box").click()
    expect(page.get_by_role("heading", level=1)).to_have_text(re.compile("cell .*voltage|shutdown circuit", re.I))


def test_without_both_links_nothing_can_be_commanded_and_nothing_is_claimed(service, open_page, violations):
    page = open_page(f"{service.base_url}/#/system")
    expect(page.get_by_test_id("command-reset")).to_be_enabled()
    with service.client() as client:
        client.post("/simulator/faults", json={"fault": "can-master-bus-off"}).raise_for_status()
        client.post("/simulator/unplug", json={"for_s": 120}).raise_for_status()
    expect(page.get_by_test_id("car-silent")).to_be_visible()
    expect(page.get_by_test_id("command-reset")).to_be_disabled()
    expect(page.get_by_test_id("trip-banner")).to_contain_text("last known")  # it has not ended, nobody can see it
    expect(page.get_by_test_id("warnings")).not_to_contain_text("No warnings:")
    assert violations(page) == {}
