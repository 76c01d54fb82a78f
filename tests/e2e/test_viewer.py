"""The session viewer on four hours of recording: a short dip is seen, a link leads to its moment, cursors read it."""

import re
from pathlib import Path

import pytest
from playwright.sync_api import expect

from app.sessions.recording.recorder import Recorder
from app.telemetry.events import Event
from app.words.message import Message
from firmware_protocol.framing import encode_frame
from firmware_protocol.memory_map import FIELDS, MASTER_SIZE
from firmware_protocol.messages import Data, MessageType, Window
from tests.fake_clock import FunctionClock
from tests.service_process import NO_CAR

HOURS = 4
START_NS = 1_790_000_000 * 10**9
DIP_S = 2.5 * 3600 + 7.3
DIP_LENGTH_S = 0.3
CELL = 30  # pack 3, cell 7
NORMAL, DIPPED = 37_000, 29_000  # 0.1 mV
WINDOWS = ((1884, 204), (2280, 116))


def times_s():
    """Every second for four hours, and at 28 Hz around the dip."""
    t_s = 0.0
    while t_s < HOURS * 3600:
        yield t_s
        t_s += 1 / 28 if abs(t_s - DIP_S) < 2 else 1.0


def record(folder: Path, name: str, *, dips: bool) -> None:
    """Write a session as the service does; at the dip two cells trip and two people set a marker in one instant."""
    now_ns = 0
    recorder = Recorder(folder, FunctionClock(lambda: now_ns, lambda: START_NS + now_ns), version="test")
    recorder.start(name)
    image = bytearray(MASTER_SIZE)
    for count, t_s in enumerate(times_s()):
        now_ns = round(t_s * 1e9)
        voltages = [NORMAL + cell for cell in range(96)]
        if dips and 0 <= t_s - DIP_S < DIP_LENGTH_S:
            voltages[CELL] = DIPPED
        FIELDS["v"].pack_into(image, voltages)
        FIELDS["v_min"].pack_into(image, (min(voltages),))
        FIELDS["v_max"].pack_into(image, (max(voltages),))
        body = Data(tuple(Window(o, bytes(image[o : o + n])) for o, n in WINDOWS)).to_body()
        raw = encode_frame(MessageType.DATA, count & 0xFF, round(t_s * 1000), body)[1:-1]
        recorder.frame(now_ns, START_NS + now_ns, 0, raw, True)
        if count % 2000 == 0:
            recorder.flush(60)
    if dips:
        at_ns = START_NS + round(DIP_S * 1e9)
        for cell in (CELL, CELL + 1):
            trip = Event(at_ns, "trip", "trip-cell-undervoltage", Message("cell-undervoltage"), cell=cell)
            recorder.event(round(DIP_S * 1e9), trip)
            recorder.marker(round(DIP_S * 1e9), at_ns, f"cell {cell}")
    recorder.close(60)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A data folder with two sessions of four hours, one with a dip."""
    data = tmp_path_factory.mktemp("viewer")
    for name, dips in (("calm", False), ("dip", True)):
        record(data / "sessions", name, dips=dips)
    return data


@pytest.fixture(scope="module")
def viewed(recorded, make_module_service):
    """The service on them, and the address of the session with the dip."""
    service = make_module_service("--serial", NO_CAR, data=recorded)
    with service.client() as client:
        found = {s["name"]: s["id"] for s in client.get("/sessions").json()["sessions"]}
    return service, found


def test_a_dip_of_300_ms_is_in_the_picture_of_four_hours(viewed, open_page):
    service, found = viewed
    with service.client() as client:
        answer = client.get(f"/sessions/{found['dip']}/series", params={"signal": "v_min", "points": 1200}).json()
    signal = answer["signals"]["v_min"]
    assert len(signal["time"]) <= 1300
    assert min(v for v in signal["min"] if v is not None) == pytest.approx(DIPPED / 10_000)

    page = open_page(f"{service.base_url}/#/sessions/{found['dip']}")
    chart = page.get_by_role("img", name=re.compile("^Lowest cell over time")).locator("canvas")
    expect(chart).to_be_visible()
    lowest = """async (canvas) => {
        await new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(drawn)));
        const { data, width, height } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
        const rows = [];
        for (let y = 0; y < height; y++)
          for (let x = 0.1 * width; x < 0.8 * width; x++) {
            const i = 4 * (y * width + Math.round(x));
            if (data[i + 3] > 60 && data[i + 2] > 1.5 * data[i] && data[i + 1] > 1.5 * data[i]) rows.push(y / height);
          }
        return [Math.min(...rows), Math.max(...rows)];
    }"""
    top, bottom = chart.evaluate(lowest)
    assert top < 0.3 < 0.7 < bottom, "the line does not reach from the other cells down to the dip"


def test_a_link_leads_to_the_moment_and_cursors_read_it(viewed, open_page):
    service, found = viewed
    dip_s = START_NS / 1e9 + DIP_S
    page = open_page(f"{service.base_url}/#/sessions/{found['dip']}?at={dip_s + 0.15:.3f}&cell={CELL}")
    row = page.get_by_test_id("readout").get_by_role("row", name=re.compile("Voltage of pack 3, cell 7"))
    expect(row).to_contain_text("2.900 V")
    expect(page.get_by_test_id("cells-at").get_by_role("link", name="pack 3, cell 7: 2.900 V")).to_be_visible()
    page.get_by_role("button", name="Cursor B").click()
    chart = page.locator(".u-over").nth(4)
    chart.click(position={"x": chart.bounding_box()["width"] / 2 + 25, "y": 40})
    expect(row).to_contain_text("2.900 … 3.703 V")
    shared = page.evaluate("location.href")
    assert f"cell={CELL}" in shared
    again = open_page(shared)
    row = again.get_by_test_id("readout").get_by_role("row", name=re.compile("Voltage of pack 3, cell 7"))
    expect(row).to_contain_text("2.900 … 3.703 V")
    again.locator(".u-over").nth(4).hover()
    again.mouse.wheel(0, -100)
    expect(again).not_to_have_url(shared)
    again.get_by_role("button", name="Whole session").click()
    expect(again).not_to_have_url(re.compile("from="))
    again.go_back()
    expect(again).to_have_url(re.compile("from="))


def test_alarms_and_markers_of_one_instant_are_all_shown(viewed, open_page):
    """A key that two of them share stops the page from drawing."""
    service, found = viewed
    page = open_page(f"{service.base_url}/#/sessions/{found['dip']}?cell={CELL}")
    trips = page.get_by_test_id("alarm-timeline")
    for cell in (7, 8):
        expect(trips.get_by_role("button", name=re.compile(f"pack 3, cell {cell},"))).to_be_visible()
    expect(page.get_by_text("cell 30")).to_be_visible()
    expect(page.get_by_text("cell 31")).to_be_visible()


def test_the_scrubber_is_worked_by_keys(viewed, open_page):
    service, found = viewed
    page = open_page(f"{service.base_url}/#/sessions/{found['dip']}")
    scrubber = page.get_by_test_id("scrubber")
    scrubber.focus()
    for key in ("+", "+", "Home", "ArrowRight"):
        page.keyboard.press(key)
    quarter_s = HOURS * 3600 // 4
    expect(page.get_by_text(re.compile("^(59:59|1:00:00)$"))).to_be_visible()
    expect(scrubber).to_have_attribute("aria-valuenow", str(quarter_s // 10 + quarter_s // 2))


def test_another_session_is_laid_over(viewed, open_page):
    service, found = viewed
    page = open_page(f"{service.base_url}/#/sessions/{found['dip']}?with={found['calm']}")
    expect(page.get_by_test_id("over")).to_have_value(found["calm"])
    expect(page.get_by_label("shifted by")).to_be_visible()


def test_a_move_asks_for_the_new_view_and_nothing_else(viewed, open_page):
    service, found = viewed
    page = open_page(f"{service.base_url}/#/sessions/{found['calm']}")
    expect(page.locator("canvas").nth(6)).to_be_visible()
    page.get_by_test_id("scrubber").focus()
    page.wait_for_load_state("networkidle")
    asked = []
    page.on("request", lambda request: "/api/" in request.url and asked.append(request.url))
    with page.expect_response(re.compile("/series.*i_fs")):
        page.keyboard.press("+")
    expect(page).to_have_url(re.compile("from="))
    page.wait_for_load_state("networkidle")
    assert [url.split("?")[0].rsplit("/", 1)[1] for url in asked] == ["series"]
