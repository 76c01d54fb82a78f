"""Take pictures of every page of a running service: python frontend/screenshots.py URL FOLDER [--small].

Debian's Chromium does it, driven by Playwright; log-in is not handled, so point it at a service on loopback. The pages
of a session show the finished one with most events, so let the service have one, with a trip. With `--small` one
picture of each page, dark and two thirds as large.
"""

import argparse
import base64
import json
import re
import shutil
import sys
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser, expect, sync_playwright

PAGES = (  # the address is the name of the picture
    "overview",
    "packs",
    "packs/3/7",
    "charging",
    "parameters",
    "can",
    "sessions",
    "season",
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
SMALL, SMALL_QUALITY = 2 / 3, 75
READING = re.compile(r"^Reading (the|both) (whole session|sessions|laps|black box)")
SETTLE_MS = 3000  # charts have lines and the scales have settled


def session_pages(url: str) -> dict[str, str]:
    """Name of the picture to address, of the pages that look back; none where no session is finished."""

    def ask(path: str) -> dict[str, Any]:
        with urllib.request.urlopen(f"{url.rstrip('/')}/api/v1/{path}", timeout=60) as answer:
            return dict(json.load(answer))

    finished = [each for each in ask("sessions")["sessions"] if not each["recording"]]
    if not finished:
        return {}
    session = max(finished, key=lambda each: int(each["event_count"]))["id"]
    pages = {"session": f"sessions/{session}", "import": "sessions/import"}
    pages |= {f"session-{tab}": f"sessions/{session}/{tab}" for tab in ("laps", "report", "export")}
    boxes = ask(f"sessions/{session}/blackboxes")["boxes"]
    if boxes:
        box = next((each for each in boxes if each["severity"] == "trip"), boxes[0])
        pages["blackbox"] = f"sessions/box/{box['id']}"
        if box["cell"] is not None:
            pages["season-cell"] = f"season?cell={box['cell']}"
    return pages


def shots(url: str) -> Iterator[tuple[str, str, str, str, dict[str, int]]]:
    """Name, address, theme, name of the size, size: all dark, light and on a phone, the first two in sunlight too."""
    pages = {page.replace("/", "-"): page for page in PAGES} | session_pages(url)
    for name, page in pages.items():
        yield name, page, "dark", "desktop", DESKTOP
        yield name, page, "light", "desktop", DESKTOP
        yield name, page, "dark", "phone", PHONE
    for page in PAGES[:2]:
        yield page, page, "sun", "desktop", DESKTOP


def take(browser: Browser, url: str, folder: Path, *, small: bool) -> None:
    """Take all pictures into `folder`; small ones of the dark pages on a desktop alone."""
    for name, page, theme, size_name, size in shots(url):
        if small and (theme, size_name) != ("dark", "desktop"):
            continue
        context = browser.new_context(viewport=size)
        context.add_init_script(f"localStorage.setItem('voltwall.theme', '{theme}')")
        tab = context.new_page()
        tab.goto(f"{url.rstrip('/')}/#/{page}")
        expect(tab.get_by_test_id("link-rs232")).to_have_attribute("data-state", "live", timeout=60_000)
        tab.wait_for_timeout(SETTLE_MS)
        expect(tab.get_by_text(READING)).to_have_count(0, timeout=60_000)
        tab.wait_for_timeout(SETTLE_MS // 3)
        path = folder / (f"{name}.webp" if small else f"{name}-{theme}-{size_name}.webp")
        session = context.new_cdp_session(tab)
        how: dict[str, Any] = {"format": "webp", "quality": QUALITY}
        if small:
            how = {"format": "webp", "quality": SMALL_QUALITY, "clip": {"x": 0, "y": 0, **size, "scale": SMALL}}
        picture = session.send("Page.captureScreenshot", how)
        path.write_bytes(base64.b64decode(picture["data"]))
        print(path)
        context.close()


def main() -> int:
    """Read the arguments and take the pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("url", help="address of a running service, as http://127.0.0.1:8000")
    parser.add_argument("folder", type=Path, help="where the pictures go")
    parser.add_argument("--small", action="store_true", help="one of each page, two thirds as large")
    arguments = parser.parse_args()
    names = ("chromium", "google-chrome", "chromium-headless-shell")
    chromium = next(filter(None, map(shutil.which, names)), None)
    if chromium is None:
        print("no chromium found: install it, for example with `apt-get install chromium`", file=sys.stderr)
        return 1
    arguments.folder.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=FLAGS)
        take(browser, arguments.url, arguments.folder, small=arguments.small)
        browser.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
