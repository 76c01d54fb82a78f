"""A service on which nothing was chosen yet: it opens the simulated car, offers to connect, and keeps the choice."""

import os
import re
import sys
from pathlib import Path

import pytest
from playwright.sync_api import expect

from tests.e2e.conftest import COUNT_CLICKS, is_too_wide, spent
from tests.forked import PLUGGED
from tests.naming_habits import letters_in_numbered_messages
from tests.service_process import Service
from tests.simulator_port import simulators


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
    expect(page.get_by_label("team's own, 96 cells")).to_be_checked()
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
    page.get_by_test_id("how-serial").check()
    page.get_by_test_id("setup-serial").fill("/dev/ttyUSB77")
    page.get_by_test_id("setup-test").click()
    expect(page.get_by_test_id("setup-look")).to_contain_text("port not found")
    expect(page.get_by_test_id("setup-look")).to_contain_text("Windows: COM6")
    page.get_by_label("JBD, 15 cells").check()
    expect(page.get_by_test_id("how-can")).to_have_count(0)  # a battery on a serial line
    expect(page.get_by_test_id("how-serial")).to_be_checked()
    expect(page.get_by_test_id("how-simulate")).to_be_visible()
    page.get_by_label("example, one signal per cell, 90 cells").check()
    page.get_by_test_id("how-simulate").check()
    page.get_by_test_id("setup-start").click()
    expect(page).to_have_url(fresh_service.base_url + "/#/overview")
    expect(page.get_by_test_id("loaded-cells")).to_contain_text("of 90")
    again = open_page(fresh_service.base_url + "/", quiet=False)
    expect(again.get_by_test_id("loaded-cells")).to_contain_text("of 90")


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
def test_a_crew_with_two_adapters_sees_its_cells_after_four_clicks(tmp_path, open_page, tell):
    master, other = str(tmp_path / "ttyUSB1"), str(tmp_path / "ttyUSB0")
    service = Service(tmp_path / "data", [], {PLUGGED: os.pathsep.join((other, master))})
    with simulators() as simulate:
        simulate("--serial", f"pty:{master}")
        service.start()
        try:
            page = open_page(service.base_url + "/#/setup", quiet=False)  # lost while it starts again
            page.evaluate(COUNT_CLICKS)
            page.get_by_test_id("how-serial").check()
            expect(page.get_by_test_id("setup-serial")).to_have_value(other)
            page.get_by_role("button", name=master).click()
            page.get_by_test_id("setup-test").click()
            expect(page.get_by_test_id("setup-look")).to_contain_text(re.compile(r"[1-9]\d* frames in"))
            page.get_by_test_id("setup-start").click()
            expect(page).to_have_url(service.base_url + "/#/overview")
            expect(page.get_by_test_id("loaded-cells")).to_have_text(re.compile(r"^\s*96\s*of 96"))
            clicks, told = spent(page)
            snapshot = service.wait_for(lambda each: None not in each["cells"]["voltage_v"])
        finally:
            service.stop()
    assert clicks == 4  # serial port, its adapter, Test, Start
    assert len(snapshot["cells"]["voltage_v"]) == 96
    assert snapshot["links"]["rs232"]["state"] == "live"
    tell(f"an adapter chosen among two, tested and started, to the cells on Overview: {told}")


def test_a_battery_is_learned_from_its_dbc_and_chosen(fresh_service, open_page):
    bundled = Path(__file__).resolve().parents[2] / "app" / "battery" / "bundled" / "one-signal-a-cell.dbc"
    page = open_page(f"{fresh_service.base_url}/#/setup")
    expect(page.get_by_label("built-in master, 96 cells")).to_be_checked()  # what is chosen has come
    page.get_by_test_id("to-learn").click()
    page.get_by_test_id("learn-files").set_input_files(bundled)
    page.get_by_test_id("learn-listen").click()
    expect(page.get_by_test_id("learn")).to_contain_text("90 cells")
    page.get_by_test_id("learn-name").fill("learned here")
    page.get_by_test_id("learn-name").blur()
    expect(page.get_by_test_id("learn-profile")).to_have_value(re.compile("learned here"))
    page.get_by_test_id("learn-keep").click()
    expect(page.get_by_label("learned here")).to_be_checked()


def test_a_suggestion_is_corrected_line_by_line_beside_what_a_log_says(fresh_service, open_page, tmp_path):
    peer = letters_in_numbered_messages()
    (tmp_path / "ams.dbc").write_text(peer.dbc())
    frames = [f"({t / 1e9:.6f}) can0 {i:03X}#{data.hex().upper()}" for t, i, data in peer.frames(3)]
    (tmp_path / "drive.log").write_text("\n".join(frames) + "\n")
    page = open_page(f"{fresh_service.base_url}/#/setup")
    expect(page.get_by_label("built-in master, 96 cells")).to_be_checked()  # what is chosen has come
    page.get_by_test_id("to-learn").click()
    page.get_by_test_id("learn-files").set_input_files(tmp_path / "ams.dbc")
    page.get_by_test_id("learn-log").set_input_files(tmp_path / "drive.log")
    page.get_by_test_id("learn-listen").click()
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
