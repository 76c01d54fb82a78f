"""The banner of a trip: over the bar and never over the page, in so many lines, its likely cause never cut."""

import json
import time
from dataclasses import asdict

import pytest
from playwright.sync_api import Page, expect

from app.words import Cell, Message, Pack, Quantity, condition, rendered
from simulator.fault_kinds import FAULTS, Target
from tests.e2e.conftest import SIZES

READS_ONLY = True

SEGMENTS = (12,) * 8
TRIPPED = 63  # pack 6, cell 4
SIZES_PX = {"desktop": (1440, 900), "laptop": (1280, 720), "phone": (390, 844)}
MOST_LINES = {"desktop": 2, "laptop": 2, "phone": 3}
THEMES = ("dark", "light", "sun")
MADE_UP = """
window.WebSocket = class {  // the live stream, of one instant whose alarms the test sets
  constructor() {
    setTimeout(() => { this.onopen?.({}); this.say(); this.timer = setInterval(() => this.say(), 100); }, 0);
  }
  say() {
    window.made ??= %s;
    window.made.seq++;
    window.made.time = Date.now() / 1000;
    this.onmessage?.({ data: JSON.stringify(window.made) });
  }
  close() { clearInterval(this.timer); }
};
"""
SHOWN = """() => {  // how many lines of text it has, where it ends, what of it is not to be seen
  const banner = document.querySelector('[data-testid="trip-banner"]');
  const page = document.querySelector('main').getBoundingClientRect();
  const box = banner.getBoundingClientRect();
  const texts = document.createTreeWalker(banner.querySelector('.text'), NodeFilter.SHOW_TEXT);
  const rects = [];
  while (texts.nextNode()) {
    const range = document.createRange();
    range.selectNodeContents(texts.currentNode);
    const isShown = texts.currentNode.data.trim() && !texts.currentNode.parentElement.closest('.vh');
    if (isShown) rects.push(...range.getClientRects());
  }
  const middles = rects.filter((r) => r.width > 1).map((r) => (r.top + r.bottom) / 2).sort((a, b) => a - b);
  const lines = middles.filter((y, i) => i === 0 || y - middles[i - 1] > 8).length;
  const outside = rects.filter((r) => r.width > 1 && (r.left < box.left - 1 || r.right > box.right + 1
    || r.top < box.top - 1 || r.bottom > box.bottom + 1)).length;
  return { lines, outside, over: Math.round(box.bottom - page.top), top: Math.round(box.top) };
}"""


def alarm(cause: Message | None, cell: int | None, *, seen: bool) -> dict:
    """The alarm of a trip at a cell, with its likely cause."""
    explained = None
    if cause is not None:
        explained = {"code": cause.code, "message": asdict(rendered(cause, SEGMENTS)), "cell": cell, "pack": None}
        explained |= {"confidence": 0.99, "others": [], "size": None, "low": None, "high": None, "unit": ""}
        explained |= {"since": None, "judged": None, "revised": False}
    what = rendered(Message("master-fault", why=Message("cell-undervoltage")), SEGMENTS)
    return {
        **{
            "id": 7,
            "code": "master-fault",
            "severity": "trip",
            "message": asdict(what),
            "since": time.time() - 180,
            "active": True,
        },
        **{"cell": TRIPPED, "value": 1.8413, "limit": 2.5, "unit": "V", "cells": [], "cause": explained},
        **{"acknowledged_by": "kari" if seen else None, "ended": None},
    }


def causes() -> dict[str, tuple[Message, int | None]]:
    """Every fault that the simulator has, as the likely cause of a trip, with the cell that it names."""
    found = {}
    for code, kind in FAULTS.items():
        if kind.target is Target.CELL:
            size = Quantity(13.99, "mohm", 2)
            found[code] = Message("cause-of-size", cause=condition(code), cell=Cell(TRIPPED), size=size), TRIPPED
        elif kind.target is Target.PACK:
            found[code] = Message("cause-in-pack", cause=condition(code), pack=Pack(5)), None
        else:
            found[code] = condition(code), None
    return found


@pytest.fixture
def tripped(service, open_page):
    """Open a page in a size, a theme and a language, on which the car has just tripped."""
    with service.client() as client:
        snapshot = client.get("/snapshot").json()
    snapshot |= {"age": dict.fromkeys(snapshot["age"], 0.1), "sent_s": None}  # every message is a new one

    def opened(size: str, theme: str, language: str = "en", address: str = "overview") -> Page:
        page = open_page(f"{service.base_url}/#/help", "phone" if size == "phone" else "desktop", theme=theme)
        page.set_viewport_size(dict(zip(("width", "height"), SIZES_PX[size], strict=True)))
        made = snapshot | {"alarms": [alarm(None, None, seen=False)]}
        page.add_init_script(MADE_UP % json.dumps(made))
        page.add_init_script(f"localStorage.setItem('voltwall.language', '{language}')")
        page.goto(f"{service.base_url}/#/{address}")
        page.reload()
        expect(page.get_by_test_id("trip-banner")).to_be_visible()
        return page

    return opened


def show(page: Page, cause: Message | None, cell: int | None, *, seen: bool = False) -> dict:
    """Let the trip have a cause, and look at the banner once it is drawn."""
    wanted = alarm(cause, cell, seen=seen)
    page.evaluate("(wanted) => { window.made = { ...window.made, alarms: [wanted] }; }", wanted)
    percent = page.get_by_test_id("trip-cause").filter(has_text="99")
    if cause is not None and not seen:
        expect(percent).to_be_visible()
    page.evaluate("async () => { for (let i = 0; i < 12; i++) await new Promise(requestAnimationFrame); }")
    return page.evaluate(SHOWN)


JOINT = causes()["joint-resistance-high"]


@pytest.mark.parametrize("theme", THEMES)
@pytest.mark.parametrize("size", SIZES_PX)
def test_it_covers_the_bar_and_nothing_of_the_page(tripped, size, theme):
    page = tripped(size, theme, address="packs")
    before = page.locator("main h1").first.bounding_box(), page.get_by_test_id("cell-0").bounding_box()
    for cause, cell in ((None, None), JOINT):
        found = show(page, cause, cell)
        assert (found["outside"], found["top"]) == (0, 0), cause
        assert found["lines"] <= MOST_LINES[size], cause
        assert found["over"] <= 0, cause
    expect(page.get_by_test_id("trip-cause")).to_contain_text("high-resistance busbar joint, 13.99\xa0mΩ (99\xa0%)")
    found = show(page, *JOINT, seen=True)
    assert (found["lines"], found["outside"], found["top"]) == (1, 0, 0)
    assert found["over"] <= 0
    for name in ("trip-cell", "trip-box"):
        expect(page.get_by_test_id(name)).to_be_in_viewport()
    expect(page.get_by_test_id("link-rs232")).to_be_visible()  # the bar is there again
    expect(page.get_by_test_id("recording")).to_be_visible()
    after = page.locator("main h1").first.bounding_box(), page.get_by_test_id("cell-0").bounding_box()
    assert after == before


@pytest.mark.parametrize("language", ["en", "nb"])
@pytest.mark.parametrize("size", ["laptop", "phone"])
def test_no_likely_cause_is_cut(tripped, size, language):
    page = tripped(size, "sun", language)
    wrong = {}
    for code, (cause, cell) in causes().items():
        found = show(page, cause, cell)
        if found["lines"] > MOST_LINES[size] or found["outside"] or found["over"] > 0:
            wrong[code] = found
    assert wrong == {}, page.get_by_test_id("trip-banner").inner_text()


def test_the_whole_screen_of_the_judge_has_it_on_top_too(tripped):
    page = tripped("desktop", "dark", address="judge")
    page.get_by_role("button", name="Full screen").click()
    expect(page.locator(".judge.full").get_by_test_id("trip-banner")).to_be_in_viewport()
    banner = page.locator(".judge.full").get_by_test_id("trip-banner").bounding_box()
    cells = page.get_by_test_id("judge-0").bounding_box(), page.get_by_test_id("judge-95").bounding_box()
    assert banner["y"] + banner["height"] <= cells[0]["y"]
    assert cells[1]["y"] + cells[1]["height"] <= SIZES["desktop"]["height"]
