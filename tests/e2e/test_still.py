"""Nothing on a page moves by itself while the car races: no card jumps, no number changes its width."""

from playwright.sync_api import expect

from tests.campaign import campaign, of_size
from tests.e2e.stillness import moved, watch

READS_ONLY = True
WATCHED_S = of_size(1, 5, 10, 60)
PAGES = {  # address: what is there once it is drawn
    "overview": ".charts canvas",
    "packs": '[data-testid="cell-30"]',
    "packs/3/7": "canvas",
    "charging": '[data-testid="cell-30"]',
    "parameters": '[data-testid="stored-v_cell_max"]',
    "can": 'main :text("tx 2")',
    "sessions/{recording}/laps": "main .panel",
    "simulator": "main .panel",
    "judge": '[data-testid="judge-oldest"]',
}


def stays_still(page, address: str) -> None:
    watch(page)
    page.evaluate("ms => new Promise((wake) => setTimeout(wake, ms))", 1000 * WATCHED_S)
    assert moved(page) == [], address


@campaign(240, 300, 1200)
def test_nothing_moves_on_any_live_page_while_the_car_races(service, open_page, tell):
    with service.client() as client:
        recording = next(s["id"] for s in client.get("/sessions").json()["sessions"] if s["recording"])
    page = open_page(f"{service.base_url}/#/overview", full_rate=True)
    for address, drawn in PAGES.items():
        page.goto(f"{service.base_url}/#/{address.format(recording=recording)}")
        expect(page.locator(drawn).first).to_be_visible()
        stays_still(page, address)
    phone = open_page(f"{service.base_url}/#/overview", "phone", full_rate=True)
    expect(phone.locator("canvas").first).to_be_visible()
    stays_still(phone, "overview on a phone")
    tell(f"layout shift of {len(PAGES) + 1} pages, {WATCHED_S} s of racing each: 0; no number changed its width")
