"""A real browser on the real service: Debian's Chromium, driven by Playwright; nothing is downloaded."""

import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest
from playwright.sync_api import Browser, BrowserContext, ConsoleMessage, Page, expect, sync_playwright
from playwright.sync_api import TimeoutError as PlaywrightTimeoutError

ROOT = Path(__file__).resolve().parents[2]
CHROMIUM = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome", "chrome")  # lightest first
FLAGS = [
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--js-flags=--no-opt --no-maglev",  # a page that lives for seconds does not earn back its optimised code
    # a page costs as much again where the browser around it, which nobody sees, draws its own pages
    "--disable-features=WebUIOmniboxPopup,WebUIOmniboxAimPopup",
]
SIZES = {
    "desktop": {"width": 1440, "height": 900},
    "phone": {"width": 390, "height": 844},
    "television": {"width": 2560, "height": 1440},
}
TOUCH = {"phone"}
PATIENCE_MS = 30_000
LAYOUT_MS = 10_000
SNAPSHOTS_PER_S = 3  # enough to see values move; drawing all 28 would keep half a processor busy
FEWER_SNAPSHOTS = f"""
window.WebSocket = class extends WebSocket {{
  constructor(url) {{ super(`${{url}}?rate={SNAPSHOTS_PER_S}`); }}
}};
"""
# It fetches and keeps every file of the application anew in every context: half of what opening a page costs.
NO_SERVICE_WORKER = """
if (navigator.serviceWorker) navigator.serviceWorker.register = () => Promise.reject(new Error('not in this test'));
"""
AXE = ROOT / "frontend" / "node_modules" / "axe-core" / "axe.min.js"
RUN_AXE = """([what, contrast]) => axe.run({
  runOnly: what, rules: contrast ? {} : { 'color-contrast': { enabled: false } },
  resultTypes: ['violations'], selectors: false, preload: false, // neither is looked at, and both cost
})"""
RULES = {
    "light": ["color-contrast"],
    "sun": ["color-contrast"],
    "dark": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa"],
}

expect.set_options(timeout=PATIENCE_MS)


COUNT_CLICKS = """() => {  // presses of a button, a link, a finger; choices of a list; kept when the page loads again
  sessionStorage.clicks = 0;
  const count = () => { sessionStorage.began ??= Date.now(); sessionStorage.clicks++; };
  addEventListener('pointerdown', count, true);
  addEventListener('change', (event) => event.target.matches('select') && count(), true);
}"""


def spent(page: Page) -> tuple[int, str]:
    """Clicks since COUNT_CLICKS, and the page's own seconds since the first one, to be told."""
    clicks, seconds = page.evaluate("[+sessionStorage.clicks, (Date.now() - sessionStorage.began) / 1000]")
    return clicks, f"{clicks} clicks, {seconds:.1f} s"


def missing(what: str, remedy: str) -> None:
    """Skip where a person runs the tests, fail where nobody would notice."""
    text = f"{what} is missing: {remedy}"
    if os.environ.get("CI"):
        pytest.fail(text)
    pytest.skip(text)


def is_too_wide(page: Page) -> bool:
    """Whether a page is wider than its screen, once its charts have their new size."""
    try:
        page.wait_for_function(
            "(width) => document.documentElement.scrollWidth <= width",
            arg=page.viewport_size["width"],
            timeout=LAYOUT_MS,
        )
    except PlaywrightTimeoutError:
        return True
    return False


@pytest.fixture(scope="package")
def browser() -> Iterator[Browser]:
    """One Chromium for all tests of this folder; with it ends the event loop that Playwright runs in this thread."""
    path = next((found for name in CHROMIUM if (found := shutil.which(name))), None)
    if path is None:
        missing("a browser", "install chromium, for example with `apt-get install chromium`")
    if not (ROOT / "app" / "static" / "index.html").exists():
        missing("the built front end", "run `make frontend`")
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=path, args=FLAGS)
        yield chromium
        chromium.close()


@pytest.fixture
def open_page(browser: Browser) -> Iterator[Callable[..., Page]]:
    """Open pages, each in a context of its own; at the end no page may have complained on its console."""
    contexts: list[BrowserContext] = []
    complaints: list[str] = []

    def listen(message: ConsoleMessage) -> None:
        if message.type in ("error", "warning"):
            complaints.append(f"{message.text} {message.location.get('url', '')}")

    def open_one(
        url: str,
        size: str = "desktop",
        *,
        quiet: bool = True,
        theme: str = "dark",
        full_rate: bool = False,
        service_worker: bool = False,
        first_visit: bool = False,
    ) -> Page:
        context = browser.new_context(
            viewport=SIZES[size], has_touch=size in TOUCH, is_mobile=size in TOUCH, ignore_https_errors=True
        )
        contexts.append(context)
        context.add_init_script(
            f"localStorage.getItem('voltwall.theme') ?? localStorage.setItem('voltwall.theme', '{theme}')"
        )
        if not first_visit:
            context.add_init_script("localStorage.setItem('voltwall.connect-card.closed', 'true')")
        if not full_rate:
            context.add_init_script(FEWER_SNAPSHOTS)
        if not service_worker:
            context.add_init_script(NO_SERVICE_WORKER)
        page = context.new_page()
        page.set_default_timeout(PATIENCE_MS)
        if quiet:
            page.on("console", listen)
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.goto(url)
        return page

    yield open_one
    for context in contexts:
        context.close()
    assert complaints == []


@pytest.fixture(scope="session")
def violations() -> Callable[..., dict[str, list[str]]]:
    """What axe-core finds on a page: WCAG 2.2 AA in the dark, contrast in every theme; rule to the places at fault.

    A page has the same colours on a phone as on a desktop, so there nothing but the layout is looked at: a fifth of
    the time.
    """
    if not AXE.exists():
        missing("axe-core", "run `make frontend`")
    source = AXE.read_text()

    def look(page: Page, *, themes: Sequence[str] = tuple(RULES)) -> dict[str, list[str]]:
        on_phone = page.viewport_size == SIZES["phone"]
        if not page.evaluate("'axe' in window"):
            page.evaluate(source)
        found = {}
        for theme in ("dark",) if on_phone else themes:
            what = RULES[theme]
            page.evaluate("(theme) => (document.documentElement.dataset.theme = theme)", theme)
            for violation in page.evaluate(RUN_AXE, [what, not on_phone])["violations"]:
                found[f"{theme}: {violation['id']}"] = [node["html"][:160] for node in violation["nodes"][:3]]
        return found

    return look
