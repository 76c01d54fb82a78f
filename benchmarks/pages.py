"""CPU and memory of the pages in a browser: `python -m benchmarks.pages [--minutes 30]`.

Chromium without a GPU reads a service with the simulated car at the fastest the line carries, on the overview with
96 cells and three charts. Heap is what is left after a collection. Scripting, style and layout are the browser's own
counters of processor time over one-second windows, divided by the frames drawn in them; tasks are traced for a few
seconds every minute, by processor time too, so that other work on the machine does not count. Then four hours of
recording, more than two million points in the charts, are opened, scrubbed through, zoomed and dragged.
"""

import argparse
import gzip
import json
import os
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from playwright.sync_api import Browser, CDPSession, Page, ViewportSize, expect, sync_playwright

from app.sessions.reading.reader import SessionFile
from benchmarks.long_session import long_session

STATIC = Path(__file__).resolve().parents[1] / "app" / "static"
FLAGS = ["--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"]
SIZE = ViewportSize(width=1440, height=900)
FASTEST_MS = 35
WARM_UP_S = 90.0
COUNTED = ("ScriptDuration", "LayoutDuration", "RecalcStyleDuration")
TRACED_S = 5.0
LONG_MS = 50.0
LOADS = 7
FIRST_VALUE = """
const look = () => {
  if (document.querySelector('[data-testid=voltage][data-freshness=live]')) window.first_value = performance.now();
  else requestAnimationFrame(look);
};
requestAnimationFrame(look);
"""
WATCH = """
window.frames_drawn = 0;
window.gaps_ms = [];
let before_ms = performance.now();
const count = (at_ms) => {
  window.frames_drawn++;
  if (gaps_ms.push(at_ms - before_ms) > 5000) gaps_ms.length = 0;
  before_ms = at_ms;
  requestAnimationFrame(count);
};
requestAnimationFrame(count);
"""


@contextmanager
def served(data: Path) -> Iterator[str]:
    """The service on a free port, for the length of a with-block; yields its address."""
    command = [sys.executable, "-m", "app.cli", "serve", "--port", "0", "--data", str(data), "--no-record"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=os.environ)
    assert process.stdout is not None
    try:
        match = None
        while match is None and (line := process.stdout.readline()):
            match = re.search(r"http://127\S+", line)
        if match is None:
            raise SystemExit("the service did not start")
        threading.Thread(target=process.stdout.read, daemon=True).start()  # a full pipe would stop it
        yield match[0]
    finally:
        process.terminate()
        process.wait(timeout=30)


def call(url: str, method: str = "GET", body: object = None, **headers: str) -> tuple[object, dict[str, str]]:
    """Return (JSON, headers) of an answer."""
    data = None if body is None else json.dumps(body).encode()
    names = {"content-type": "application/json", "accept": "application/json"} | headers
    request = urllib.request.Request(url, data=data, method=method, headers=names)
    with urllib.request.urlopen(request, timeout=30) as answer:
        return json.loads(answer.read() or b"null"), dict(answer.headers)


def stream_fast(url: str) -> None:
    """Set the master's sampling time to the shortest that the line carries."""
    for _ in range(50):
        try:
            config, _headers = call(f"{url}/api/v1/config")
            tag = str(config["hash"])  # type: ignore[index]
            call(
                f"{url}/api/v1/config?reason=benchmark",
                "PUT",
                {"values": {"telemetry_period": FASTEST_MS}},
                **{"If-Match": f'"{tag}"'},
            )
        except OSError:
            time.sleep(0.2)
        else:
            return
    raise SystemExit("the master did not take the sampling time")


def count_frames(url: str) -> int:
    """Snapshots that the service made of RS232 frames so far, by its own count."""
    snapshot, _headers = call(f"{url}/api/v1/snapshot")
    return int(snapshot["seq"])  # type: ignore[index]


def initial_bundle_bytes() -> int:
    """Bytes, each file gzipped, that index.html asks for before anything is shown."""
    page = (STATIC / "index.html").read_text()
    names = re.findall(r'(?:src|href)="\./(assets/[^"]+\.(?:js|css))"', page)
    return sum(len(gzip.compress((STATIC / name).read_bytes(), 9)) for name in names)


def metrics(session: CDPSession) -> dict[str, float]:
    """The browser's counters."""
    return {m["name"]: m["value"] for m in session.send("Performance.getMetrics")["metrics"]}


def heap_mb(session: CDPSession) -> float:
    """JavaScript heap after a collection [MB]."""
    session.send("HeapProfiler.collectGarbage")
    return float(session.send("Runtime.getHeapUsage")["usedSize"]) / 1e6


def traced_tasks_ms(browser: Browser, page: Page, act: Callable[[], None]) -> list[float]:
    """Processor time of each task of the page's main thread while `act` runs [ms]."""
    browser.start_tracing(page=page, categories=["toplevel", "devtools.timeline", "__metadata"])
    act()
    events = json.loads(browser.stop_tracing())["traceEvents"]
    threads = {
        (e["pid"], e["tid"])
        for e in events
        if e["name"] == "thread_name" and e.get("args", {}).get("name") == "CrRendererMain"
    }
    tasks = (e for e in events if e["name"].endswith("RunTask") and (e["pid"], e["tid"]) in threads)
    return [e["tdur"] / 1000 for e in tasks if "tdur" in e]


def first_paint(browser: Browser, url: str) -> None:
    """Measure how soon a browser that was never here shows the frame, and the car's voltage."""
    paints_ms, values_ms = [], []
    for _ in range(LOADS):
        context = browser.new_context(viewport=SIZE, service_workers="block")
        context.add_init_script(FIRST_VALUE)
        page = context.new_page()
        page.goto(f"{url}/#/overview")
        expect(page.locator('[data-testid=voltage][data-freshness="live"]')).to_be_visible()
        paints_ms.append(page.evaluate("performance.getEntriesByName('first-contentful-paint')[0].startTime"))
        values_ms.append(page.evaluate("first_value"))
        context.close()
    for what, times_ms in (("first contentful paint", paints_ms), ("first live voltage", values_ms)):
        print(f"{what}: median {statistics.median(times_ms):.0f} ms, best {min(times_ms):.0f} ms of {LOADS}")


def live(browser: Browser, url: str, minutes: float) -> None:
    """Measure the overview under the live stream."""
    context = browser.new_context(viewport=SIZE)
    first_paint(browser, url)
    context.add_init_script(WATCH)
    page = context.new_page()
    session = context.new_cdp_session(page)
    session.send("Performance.enable", {"timeDomain": "threadTicks"})
    session.send("HeapProfiler.enable")
    page.goto(f"{url}/#/overview")
    expect(page.get_by_test_id("link-rs232")).to_have_attribute("data-state", "live")
    time.sleep(min(WARM_UP_S, minutes * 30))
    before_mb = heap_mb(session)
    first_frame, began_s = count_frames(url), time.monotonic()
    per_frame_ms, script_ms, rates, tasks_ms = [], [], [], []
    last, frames, at = metrics(session), page.evaluate("frames_drawn"), time.monotonic()
    until, next_heap, heaps = at + minutes * 60, at + 60, [before_mb]
    while time.monotonic() < until:
        time.sleep(1.0)
        now, drawn, now_s = metrics(session), page.evaluate("frames_drawn"), time.monotonic()
        if drawn > frames:
            spent_s = sum(now[name] - last[name] for name in COUNTED)
            per_frame_ms.append(1000 * spent_s / (drawn - frames))
            script_ms.append(1000 * (now["ScriptDuration"] - last["ScriptDuration"]) / (drawn - frames))
            rates.append((drawn - frames) / (now_s - at))
        last, frames, at = now, drawn, now_s
        if now_s >= next_heap:
            next_heap += 60
            tasks_ms += traced_tasks_ms(browser, page, lambda: time.sleep(TRACED_S))
            heaps.append(heap_mb(session))
            last, frames, at = metrics(session), page.evaluate("frames_drawn"), time.monotonic()
    after_mb = heap_mb(session)
    rate_hz = (count_frames(url) - first_frame) / (time.monotonic() - began_s)
    print(
        f"{minutes:g} min of {rate_hz:.1f} snapshots a second, those that only aged among them; "
        f"{statistics.median(rates):.0f} animation frames a second"
    )
    print(f"heap after warm-up {before_mb:.2f} MB, at the end {after_mb:.2f} MB: {after_mb - before_mb:+.2f} MB")
    print(f"  each minute: {', '.join(f'{mb:.1f}' for mb in heaps[:: max(1, len(heaps) // 15)])}")
    print(f"scripting a frame: {statistics.median(script_ms):.2f} ms of processor time, median of seconds")
    print(f"  with style and layout: {statistics.median(per_frame_ms):.2f} ms")
    tell_tasks(tasks_ms)
    context.close()


def tell_tasks(tasks_ms: list[float]) -> None:
    """Print how many tasks were long."""
    over = sum(length > LONG_MS for length in tasks_ms)
    print(f"tasks over {LONG_MS:.0f} ms of processor time: {over} of {len(tasks_ms)} traced", end="")
    print(f", the longest {max(tasks_ms):.0f} ms" if tasks_ms else "")


def drawn(page: Page) -> None:
    """Wait until the change is on the screen."""
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


def scrub(browser: Browser, url: str, session_id: str) -> None:
    """Open a long session and move through it."""
    opening_s = []
    for _ in range(3):
        context = browser.new_context(viewport=SIZE)
        page = context.new_page()
        page.goto(f"{url}/#/sessions")
        expect(page.get_by_test_id("sessions")).to_be_visible()
        start_s = time.perf_counter()
        page.evaluate(f"void (location.hash = '#/sessions/{session_id}')")
        page.locator("canvas").nth(6).wait_for()
        drawn(page)
        opening_s.append(time.perf_counter() - start_s)
        if len(opening_s) < 3:
            context.close()
    moves_s = []
    page.get_by_test_id("scrubber").focus()
    for key in ("+", "+", "Home", *["ArrowRight"] * 8, "+", "+", *["PageDown"] * 4):
        start_s = time.perf_counter()
        with page.expect_response(re.compile("/series.*i_fs")):
            page.keyboard.press(key)
        drawn(page)
        moves_s.append(time.perf_counter() - start_s)
    print(f"the session, opened with 7 charts: {min(opening_s):.2f} s at best, {max(opening_s):.2f} s at worst of 3")
    print(f"  scrubbed: median {statistics.median(moves_s):.2f} s, worst {max(moves_s):.2f} s of {len(moves_s)} moves")
    context.close()


def samples_behind(page: Page, path: Path) -> tuple[int, bool]:
    """Return how many samples the charts of a session stand for, and whether each shows its extremes."""
    with page.expect_response(re.compile("/series.*i_fs")) as waited:
        page.get_by_role("button", name="Whole session").click()
    count, kept = 0, True
    with SessionFile(path) as session:
        for name, shown in waited.value.json()["signals"].items():
            signal = session.signals.find(name)
            every = signal.physical(session.samples([signal])[0].counts)
            if every.size == 0:
                continue
            count += every.size
            least = min(value for value in shown["min"] if value is not None)
            most = max(value for value in shown["max"] if value is not None)
            kept &= np.allclose((least, most), (np.nanmin(every), np.nanmax(every)), rtol=0, atol=1e-6)
    return count, kept


def drag(page: Page) -> None:
    """Zoom in and out of a session, drag the window in view over it, drag its end: 300 moves, one a frame."""
    strip = page.get_by_test_id("scrubber")
    strip.focus()
    for key in ("+", "+", "-", "+", "+", "-", "+"):
        page.keyboard.press(key)
        drawn(page)
    box = strip.bounding_box()
    assert box is not None
    middle = box["y"] + box["height"] / 2
    for start, end in ((0.5, 0.9), (0.9, 0.1), (0.1, 0.5)):
        page.mouse.move(box["x"] + start * box["width"], middle)
        page.mouse.down()
        for step in range(1, 101):
            page.mouse.move(box["x"] + (start + (end - start) * step / 100) * box["width"], middle)
            drawn(page)
        page.mouse.up()


def millions(browser: Browser, url: str, path: Path) -> None:
    """Measure panning and zooming with every sample of a long session behind the charts."""
    context = browser.new_context(viewport=SIZE)
    context.add_init_script(WATCH)
    page = context.new_page()
    page.goto(f"{url}/#/sessions/{path.stem}")
    page.locator("canvas").nth(6).wait_for()
    drawn(page)
    page.evaluate("gaps_ms.length = 0")
    tasks_ms = traced_tasks_ms(browser, page, lambda: drag(page))
    gaps_ms = sorted(page.evaluate("gaps_ms"))
    count, kept = samples_behind(page, path)
    print(f"{count / 1e6:.2f} million points in view, zoomed and dragged: a frame every", end=" ")
    print(f"{statistics.median(gaps_ms):.0f} ms, of 100 one after {gaps_ms[int(0.99 * len(gaps_ms))]:.0f} ms or later")
    tell_tasks(tasks_ms)
    print(f"extremes of all of them in the picture of the whole: {'kept' if kept else 'LOST'}")
    context.close()


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=30.0, help="of the live stream (default %(default)s)")
    parser.add_argument("--hours", type=float, default=4.0, help="of the recorded session (default %(default)s)")
    parser.add_argument("--ts", type=float, default=0.035, help="its sampling time [s] (default %(default)s)")
    parser.add_argument("--only", choices=("live", "session"), help="one of the two halves")
    args = parser.parse_args()
    names = ("chromium", "google-chrome", "chromium-headless-shell")
    chromium = next(filter(None, map(shutil.which, names)), None)
    if chromium is None:
        raise SystemExit("no chromium found")
    print(f"initial bundle: {initial_bundle_bytes() / 1000:.1f} kB gzipped")
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as folder:
        browser = playwright.chromium.launch(executable_path=chromium, args=FLAGS)
        if args.only != "session":
            with served(Path(folder) / "live") as url:
                stream_fast(url)
                live(browser, url, args.minutes)
        if args.only != "live":
            data = Path(folder) / "long"
            path = long_session(data / "sessions", args.ts, args.hours)
            with served(data) as url:
                scrub(browser, url, path.stem)
                millions(browser, url, path)
        browser.close()


if __name__ == "__main__":
    main()
