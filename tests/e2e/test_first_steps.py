"""A service on which nothing was chosen yet: it opens the simulated car, offers to connect, and keeps the choice."""

import os
import re
import sys
from pathlib import Path

import pytest
from playwright.sync_api import expect

from tests.campaign import IS_FULL
from tests.e2e.conftest import COUNT_CLICKS, is_too_wide, spent
from tests.forked import PLUGGED
from tests.naming_habits import letters_in_numbered_messages
from tests.service_process import Service
from tests.simulator_port import Simulator

ON_TERMINALS = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
BUNDLED = Path(__file__).resolve().parents[2] / "app" / "battery" / "bundled"


@pytest.fixture
def fresh_service(tmp_path):
    """Bare `serve` on an empty data folder; it outlives the pages."""
    service = Service(tmp_path, []).start()
    yield service
    service.stop()


@pytest.mark.parametrize("size", ["desktop", "phone"])
def test_the_first_page_is_the_live_car_with_a_card_that_stays_away_once_closed(fresh_service, open_page, size):
    page = open_page(fresh_service.base_url + "/", size, first_visit=True)
    card = page.get_by_test_id("connect-card")
    expect(card).to_contain_text("Simulated car.")
    expect(page.get_by_test_id("loaded-cells")).to_have_text(re.compile(r"of 96"))
    assert not is_too_wide(page)
    page.get_by_test_id("close-card").click()
    expect(card).to_have_count(0)
    page.reload()
    expect(page.get_by_test_id("loaded-cells")).to_have_text(re.compile(r"of 96"))
    expect(card).to_have_count(0)


def test_keeping_what_runs_shows_the_overview_at_once(fresh_service, open_page):
    page = open_page(fresh_service.base_url + "/#/setup")
    expect(page.get_by_label("built-in master, 96 cells")).to_be_checked()
    with fresh_service.client() as client:
        before = client.get("/setup").json()["instance"]
        page.get_by_test_id("setup-start").click()
        expect(page).to_have_url(fresh_service.base_url + "/#/overview")
        expect(page.get_by_test_id("loaded-cells")).to_have_text(re.compile(r"of 96"))
        assert client.get("/setup").json()["instance"] == before


def test_the_card_leads_to_the_choice_and_the_choice_takes_effect(fresh_service, open_page):
    page = open_page(fresh_service.base_url + "/", quiet=False, first_visit=True)  # lost while it starts again
    page.get_by_test_id("connect-yours").click()
    expect(page.get_by_role("heading", name="Connect to a battery")).to_be_visible()
    expect(page.get_by_test_id("setup-start")).to_have_text("Keep this connection")
    page.get_by_test_id("setup-serial").fill("/dev/ttyUSB77")
    page.get_by_test_id("setup-serial").blur()
    page.get_by_role("button", name="Test /dev/ttyUSB77").click()
    expect(page.get_by_test_id("link-result")).to_contain_text("port not found: /dev/ttyUSB77")
    expect(page.get_by_test_id("link-result")).to_contain_text("Windows: COM6")
    page.get_by_label("JBD, 15 cells").check()
    expect(page.get_by_test_id("setup-can")).to_have_count(0)  # a battery on a serial line
    expect(page.get_by_test_id("setup-start")).to_have_text("Connect")
    page.get_by_test_id("no-serial").check()
    expect(page.get_by_test_id("simulates")).to_be_visible()
    page.get_by_label("example, one signal per cell, 90 cells").check()
    expect(page.get_by_test_id("setup-serial")).to_have_count(0)
    expect(page.get_by_test_id("setup-start")).to_have_text("Start the simulator")
    page.get_by_test_id("setup-start").click()
    expect(page).to_have_url(fresh_service.base_url + "/#/overview")
    expect(page.get_by_test_id("loaded-cells")).to_contain_text("of 90")
    again = open_page(fresh_service.base_url + "/", quiet=False)
    expect(again.get_by_test_id("loaded-cells")).to_contain_text("of 90")


@pytest.fixture
def crew(tmp_path):
    """Return a function that starts simulators and then a service that finds adapters at these paths plugged in."""
    started = []

    def start(*plugged, simulated):
        started.extend(Simulator(["simulate", *arguments], program="app.cli").start() for arguments in simulated)
        service = Service(tmp_path / "data", [], {PLUGGED: os.pathsep.join(plugged)}).start()
        started.insert(0, service)  # it stops before the terminals close
        return service

    yield start
    for each in started:
        each.stop()


@ON_TERMINALS
def test_a_battery_on_a_serial_line_is_live_after_three_actions(crew, tmp_path, open_page, tell):
    line, other = str(tmp_path / "ttyUSB1"), str(tmp_path / "ttyUSB0")
    service = crew(other, line, simulated=[("--battery", "jbd", "--serial", f"pty:{line}")])
    page = open_page(service.base_url + "/", quiet=False, first_visit=True)  # lost while it starts again
    page.evaluate(COUNT_CLICKS)
    page.get_by_test_id("connect-yours").click()
    row = page.get_by_test_id("row-serial").filter(has_text=line)
    expect(row).to_contain_text("FT232R USB UART · 0403")
    row.get_by_test_id("test-serial").click()
    expect(row).to_contain_text("Looks like JBD, 15 cells")
    expect(row.get_by_test_id("link-trials")).to_contain_text("115200 8E1: no frames")
    expect(row.get_by_test_id("link-trials")).to_contain_text("9600 8N1")
    expect(page.get_by_label("JBD, 15 cells")).to_be_checked()
    expect(row.get_by_role("radio")).to_be_checked()
    page.get_by_test_id("setup-start").click()
    expect(page).to_have_url(service.base_url + "/#/overview")
    expect(page.get_by_test_id("loaded-cells")).to_have_text(re.compile(r"^\s*15\s*of 15"))
    clicks, told = spent(page)
    seconds = page.evaluate("(Date.now() - sessionStorage.began) / 1000")
    snapshot = service.wait_for(lambda each: None not in each["cells"]["voltage_v"])
    assert snapshot["links"]["rs232"]["state"] == "live"
    assert clicks <= 3
    assert not IS_FULL or seconds < 30
    tell(f"a battery on a serial line, an adapter among two, to its cells on Overview: {told}")


@ON_TERMINALS
@pytest.mark.timeout(240)  # the battery's own round takes 37 s
def test_a_battery_with_a_dbc_is_live_after_four_actions_with_all_of_its_cells(crew, tmp_path, open_page, tell):
    """An Orion at 250 kbit/s: its 72 cells have their turn within 37 s."""
    adapter = str(tmp_path / "ttyACM0")
    service = crew(
        adapter, simulated=[("--battery", "orion-bms-2", "--can", f"slcan-pty:{adapter}", "--bit-rate", "250000")]
    )
    page = open_page(service.base_url + "/", quiet=False, first_visit=True)  # lost while it starts again
    page.evaluate(COUNT_CLICKS)
    page.get_by_test_id("connect-yours").click()
    expect(page.get_by_test_id("row-can")).to_contain_text(f"slcan:{adapter}")
    page.get_by_test_id("learn-files").set_input_files(BUNDLED / "orion-bms-2.dbc")  # the second action
    expect(page.get_by_test_id("link-trials")).to_have_text(
        re.compile(r"500 kbit/s: no frames\s*250 kbit/s: \d+ frames")
    )
    expect(page.get_by_test_id("learn-progress")).to_contain_text("cells so far")
    expect(page.get_by_test_id("learn-progress")).to_contain_text("complete", timeout=130_000)
    expect(page.get_by_test_id("now-voltage")).to_contain_text("72 of 72 received")
    page.get_by_test_id("setup-start").click()
    expect(page).to_have_url(service.base_url + "/#/overview")
    expect(page.get_by_test_id("loaded-cells")).to_have_text(re.compile(r"of 72"))
    clicks, told = spent(page)
    seconds = page.evaluate("(Date.now() - sessionStorage.began) / 1000")
    assert clicks + 1 <= 4  # and the choice of the file
    assert not IS_FULL or seconds < 60
    tell(f"a DBC and an adapter, an Orion's round of 72 cells recorded, to Overview: {told} and a file")


def test_a_battery_is_learned_from_its_dbc_and_chosen(fresh_service, open_page):
    page = open_page(f"{fresh_service.base_url}/#/setup")
    expect(page.get_by_label("built-in master, 96 cells")).to_be_checked()  # what is chosen has come
    page.get_by_test_id("learn-files").set_input_files(BUNDLED / "one-signal-a-cell.dbc")
    page.get_by_test_id("learn-listen").click()
    expect(page.get_by_test_id("learn")).to_contain_text("90 cells")
    page.get_by_test_id("learn-name").fill("learned here")
    page.get_by_test_id("learn-name").blur()
    expect(page.get_by_test_id("learn-profile")).to_have_value(re.compile("learned here"))
    expect(page.get_by_test_id("setup-start")).to_have_text("Save profile")
    page.get_by_test_id("setup-start").click()
    expect(page.get_by_label("learned here")).to_be_checked()


def test_a_suggestion_is_corrected_line_by_line_beside_what_a_log_says(fresh_service, open_page, tmp_path):
    peer = letters_in_numbered_messages()
    (tmp_path / "ams.dbc").write_text(peer.dbc())
    frames = [f"({t / 1e9:.6f}) can0 {i:03X}#{data.hex().upper()}" for t, i, data in peer.frames(3)]
    (tmp_path / "drive.log").write_text("\n".join(frames) + "\n")
    page = open_page(f"{fresh_service.base_url}/#/setup")
    expect(page.get_by_label("built-in master, 96 cells")).to_be_checked()  # what is chosen has come
    page.get_by_test_id("learn-files").set_input_files(tmp_path / "ams.dbc")
    page.get_by_test_id("learn-log").set_input_files(tmp_path / "drive.log")
    expect(page.get_by_test_id("now-voltage")).to_contain_text("160 of 160 received")
    expect(page.get_by_test_id("now-state.closed")).to_contain_text("TS_ACTIVE")
    closed = page.get_by_test_id("line-state.closed").get_by_role("checkbox")
    expect(closed).not_to_be_checked()
    closed.check()
    profile = page.get_by_test_id("learn-profile")
    expect(profile).to_have_value(re.compile(r"^\[source\.state\.closed\]", re.MULTILINE))
    page.get_by_test_id("line-current").get_by_role("checkbox").uncheck()
    expect(page.get_by_test_id("learn-checks")).to_contain_text("no current")
    page.get_by_test_id("learn-segments").fill("80, 80")
    page.get_by_test_id("learn-segments").blur()
    expect(profile).to_have_value(re.compile(r"packs = \[80, 80\]"))
