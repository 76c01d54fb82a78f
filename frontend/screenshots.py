"""Make the documentation's screenshots from a running service: python frontend/screenshots.py URL [FOLDER].

Debian's Chromium does it, driven by Playwright; log-in is not handled, so point it at a service on loopback.
"""

import argparse
import base64
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

from playwright.sync_api import Browser, expect, sync_playwright

PAGES = (
    "overview",
    "packs",
    "packs/3/7",
    "charging",
    "parameters",
    "can",
    "sessions",
    "events",
    "system",
    "simulator",
    "help",
    "judge",
)
DESKTOP = {"width": 1440, "height": 900}
PHONE = {"width": 390, "height": 844}
FLAGS = ["--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"]
QUALITY = 92
SETTLE_MS = 3000  # charts have lines and the scales have settled


def shots() -> Iterator[tuple[str, str, str, dict[str, int]]]:
    """Page, theme, name of the size, size: every page dark, light and on a phone, the first two in sunlight too."""
    for page in PAGES:
        yield page, "dark", "desktop", DESKTOP
        yield page, "light", "desktop", DESKTOP
        yield page, "dark", "phone", PHONE
    for page in PAGES[:2]:
        yield page, "sun", "desktop", DESKTOP


def take(browser: Browser, url: str, folder: Path) -> None:
    """Take all pictures into `folder`."""
    for page, theme, name, size in shots():
        context = browser.new_context(viewport=size)
        context.add_init_script(f"localStorage.setItem('voltwall.theme', '{theme}')")
        tab = context.new_page()
        tab.goto(f"{url.rstrip('/')}/#/{page}")
        expect(tab.get_by_test_id("link-rs232")).to_have_attribute("data-state", "live")
        tab.wait_for_timeout(SETTLE_MS)
        path = folder / f"{page.replace('/', '-')}-{theme}-{name}.webp"
        session = context.new_cdp_session(tab)
        picture = session.send("Page.captureScreenshot", {"format": "webp", "quality": QUALITY})
        path.write_bytes(base64.b64decode(picture["data"]))
        print(path)
        context.close()


def main() -> int:
    """Read the arguments and take the pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("url", help="address of a running service, as http://127.0.0.1:8000")
    parser.add_argument("folder", nargs="?", type=Path, default=Path("docs/images/screens"))
    arguments = parser.parse_args()
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    if chromium is None:
        print("no chromium found: install it, for example with `apt-get install chromium`", file=sys.stderr)
        return 1
    arguments.folder.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=FLAGS)
        take(browser, arguments.url, arguments.folder)
        browser.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
