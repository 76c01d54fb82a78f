"""Twelve pages look as they did when their pictures were last reviewed.

The pages show made-up answers of one instant (`frontend/fixtures`) and one recorded session, so nothing moves. Pictures
are compared after both were reduced to an eighth: the edges of letters, which every system draws in its own way,
vanish; what moved by a line, changed its colour or is cut does not. VOLTWALL_PICTURES=renew takes the pictures anew.
"""

import json
import os
import re
import shutil
import sqlite3
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import closing
from io import BytesIO
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, Page, Route, expect

from tests.campaign import IS_FULL
from tests.e2e.conftest import CHROMIUM, FLAGS, NO_SERVICE_WORKER, ROOT, SIZES
from tests.node import node
from tests.recorded.arrays import SessionMaker
from tests.service_process import NO_CAR

RENEWS = os.environ.get("VOLTWALL_PICTURES") == "renew"
PICTURES = Path(__file__).parent / "pictures"
FOUND = Path(tempfile.gettempdir(), "voltwall-pictures")

pytestmark = [
    pytest.mark.skipif(not IS_FULL and not RENEWS, reason="in the full campaign"),
    pytest.mark.timeout(240),
]

SHRINK = 8
DIFFERS = 20  # levels of 255: a word in another place; other smoothing of letters changes a fifth of it
MOST_DIFFERENT = 0.001  # share of the picture; another build of Chromium: 0.0006, a card that moved by a line: 0.03
QUALITY = 78
LASTS_NS = 240_000_000_000

ANSWERS = ["me", "health", "battery", "batteries", "snapshot", "history", "history?cell=30", "events"]
ANSWERS += ["config", "config/schema", "config/stored", "config/profiles", "config/history"]
SHOTS = {  # name: scenario, address, theme, size, what is there once it is drawn
    "overview": ("drive", "overview", "dark", "desktop", ".charts canvas"),
    "overview-fault": ("fault", "overview", "light", "desktop", '[data-testid="trip-banner"]'),
    "overview-sun": ("missing", "overview", "sun", "desktop", ".charts canvas"),
    "overview-empty": ("empty", "overview", "dark", "desktop", '[data-testid="cell-30"]'),
    "overview-phone": ("drive", "overview", "dark", "phone", '[data-testid="cell-30"]'),
    "overview-phone-fault": ("fault", "overview", "light", "phone", '[data-testid="trip-banner"]'),
    "packs": ("charge", "packs", "light", "desktop", '[data-testid="cell-30"]'),
    "cell": ("fault", "packs/3/7", "dark", "desktop", '[data-testid="neighbours"]'),
    "parameters": ("drive", "parameters", "dark", "desktop", '[data-testid="stored-v_cell_max"]'),
    "session": ("drive", "sessions/{session}", "dark", "desktop", "canvas"),
    "report": ("drive", "sessions/{session}/report", "light", "desktop", "figure svg"),
    "blackbox": ("drive", "sessions/box/{box}", "dark", "desktop", "figure svg"),
}
SOCKET = """
performance.now = () => 5000;  // nothing grows old
window.WebSocket = class {
  constructor() { setTimeout(() => { this.onopen?.({}); this.say(); setInterval(() => this.say(), 500); }, 0); }
  say() { this.onmessage?.({ data: JSON.stringify(%s) }); }
  close() {}
};
"""


@pytest.fixture(scope="module")
def made_up() -> dict:
    """The answers of every scenario, at one instant."""
    program = [node(), str(ROOT / "frontend" / "fixtures" / "print.ts"), *ANSWERS]
    return json.loads(subprocess.run(program, check=True, capture_output=True, timeout=60).stdout)


@pytest.fixture(scope="module")
def recorded(make_module_service, tmp_path_factory):
    """A service with one finished session, in which a cell trips; its address, the session and its black box."""
    data = tmp_path_factory.mktemp("pictures")
    time_s = np.arange(0.0, 240.0, 0.5)
    current_a = np.where(np.sin(time_s / 60 * 44) + np.sin(time_s / 60 * 19 + 1) > 0, 120.0, -20.0)
    volts = 3.7 - 0.002 * current_a[:, None] * np.ones(96) + 0.004 * np.sin(12.9898 * np.arange(96))
    volts[(time_s > 99) & (time_s < 101), 30] = 2.3
    trip = {"severity": "trip", "code": "trip-cell-undervoltage", "text": "cell under-voltage", "cell": 30, "unit": "V"}
    events = [trip | {"at_s": 100.0, "value": 2.3, "limit": 2.5}]
    laps = [(60.0 * k, "lap", "") for k in range(4)]
    session = SessionMaker(data / "sessions")(time_s, current_a, volts, 25, 0.8, markers=laps, events=events).stem
    with closing(sqlite3.connect(data / "sessions" / f"{session}.sqlite")) as file, file:  # the maker's clock stands
        file.execute("UPDATE meta SET value = value + ? WHERE key IN ('end_wall_ns', 'end_mono_ns')", (LASTS_NS,))
    service = make_module_service("--serial", NO_CAR, data=data)
    with service.client() as client:
        box = client.get(f"/sessions/{session}/blackboxes").json()["boxes"][0]["id"]
    return service.base_url, {"session": session, "box": box}


@pytest.fixture(scope="module")
def plain_browser(browser: Browser) -> Iterator[Browser]:
    """One that breaks lines at the same letters on every system: widths of letters as the font has them."""
    path = next(found for name in CHROMIUM if (found := shutil.which(name)))
    arguments = [*FLAGS, "--font-render-hinting=none", "--disable-lcd-text", "--force-color-profile=srgb"]
    started = browser.browser_type.launch(executable_path=path, args=arguments)
    yield started
    started.close()


def instant(page: Page, made_up: dict, scenario: str) -> None:
    """Let a page live in one instant of a scenario."""
    chosen = made_up["scenarios"][scenario]

    def answer(route: Route) -> None:
        url = urlsplit(route.request.url)
        path = url.path.partition("/api/v1/")[2]
        cell = parse_qs(url.query).get("cell")
        found = chosen["answers"].get(f"{path}?cell={cell[0]}" if cell else path)
        if found is None:
            route.continue_()
        else:
            route.fulfill(status=found["status"], json=found["json"])

    page.route(re.compile("/api/v1/"), answer)
    page.clock.set_fixed_time(1000 * made_up["now_s"])
    page.add_init_script(SOCKET % json.dumps(chosen["snapshot"]))
    page.add_init_script(NO_SERVICE_WORKER)


def difference(was: bytes, now: bytes) -> float:
    """Return which part of two pictures differs."""

    small = []
    for picture in (was, now):
        with Image.open(BytesIO(picture)) as image:
            size = image.width // SHRINK, image.height // SHRINK
            small.append(np.asarray(image.convert("RGB").resize(size, Image.Resampling.BOX), dtype=np.int16))
    if small[0].shape != small[1].shape:
        return 1.0
    return float((np.abs(small[0] - small[1]).max(axis=2) > DIFFERS).mean())


def webp(png: bytes) -> bytes:
    """A picture as it is kept."""

    kept = BytesIO()
    with Image.open(BytesIO(png)) as image:
        image.convert("RGB").save(kept, "WEBP", quality=QUALITY, method=6)
    return kept.getvalue()


@pytest.mark.parametrize("name", SHOTS)
def test_a_page_looks_as_it_did_when_it_was_reviewed(plain_browser, made_up, recorded, name):
    scenario, address, theme, size, drawn = SHOTS[name]
    base_url, ids = recorded
    context = plain_browser.new_context(
        viewport=SIZES[size], timezone_id="UTC", locale="en-GB", reduced_motion="reduce"
    )
    try:
        page = context.new_page()
        page.add_init_script(f"localStorage.setItem('voltwall.theme', '{theme}')")
        instant(page, made_up, scenario)
        page.goto(f"{base_url}/#/{address.format(**ids)}")
        expect(page.locator(drawn).first).to_be_visible(timeout=90_000)
        page.wait_for_load_state("networkidle")
        page.evaluate("document.fonts.ready")
        now = before = page.screenshot()
        for _ in range(20):  # charts are drawn one a frame: until two pictures are the same
            page.wait_for_timeout(300)
            now = page.screenshot()
            if now == before:
                break
            before = now
    finally:
        context.close()
    kept = PICTURES / f"{name}.webp"
    if RENEWS:
        if not kept.exists() or difference(kept.read_bytes(), now) > 0:
            kept.write_bytes(webp(now))
        return
    part = difference(kept.read_bytes(), now)
    if part > MOST_DIFFERENT:
        FOUND.mkdir(exist_ok=True)
        (FOUND / f"{name}.png").write_bytes(now)
    assert part <= MOST_DIFFERENT, f"{100 * part:.2f} % differ: look at {kept} and {FOUND}; if meant, `make pictures`"
