"""Recording: started and stopped by hand, marked, looked at, taken away."""

import csv
import io
import re

import pytest
from playwright.sync_api import expect


@pytest.mark.parametrize("size", ["desktop", "phone"])
def test_a_session_is_recorded_marked_viewed_and_downloaded(make_service, open_page, size):
    service = make_service("--seed", "5", "--no-record")
    service.wait_for(lambda s: s["accumulator"]["loaded_cells"] == 96)
    page = open_page(f"{service.base_url}/#/sessions", size)
    page.get_by_role("textbox", name="Session name").fill("run 3")
    page.get_by_test_id("record").click()
    expect(page.get_by_test_id("recording")).to_contain_text("REC")
    page.get_by_role("textbox", name="Marker text").fill("driver change")
    page.get_by_role("button", name="Set marker").click()
    expect(page.get_by_text("Marked: driver change")).to_be_visible()
    service.wait_for(lambda s: s["recording"] and s["recording"]["frames"] > 60)
    page.get_by_test_id("stop").click()
    page.get_by_test_id("confirm").click()
    expect(page.get_by_test_id("record")).to_be_enabled()

    row = page.get_by_test_id("sessions").get_by_role("row", name=re.compile("run 3"))
    with page.expect_download() as download:
        row.get_by_role("link", name="CSV").click()
    table = list(csv.reader(io.StringIO(download.value.path().read_text())))
    assert len(table) > 10

    row.get_by_role("link", name="run 3").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("run 3")
    expect(page.locator("canvas")).to_have_count(7)
    expect(page.get_by_text("driver change")).to_be_visible()


def test_a_session_is_replayed_and_the_car_comes_back(make_service, open_page):
    service = make_service("--seed", "6")
    service.wait_for(lambda s: s["recording"] and s["recording"]["frames"] > 30)
    page = open_page(f"{service.base_url}/#/sessions")
    page.get_by_test_id("stop").click()
    page.get_by_test_id("confirm").click()
    service.wait_for(lambda s: s["master"]["state"] == "drive")
    expect(page.get_by_test_id("recording")).to_contain_text("NO REC")
    page.get_by_role("button", name="Replay").first.click()
    expect(page.get_by_role("region", name="Replay")).to_be_visible()
    expect(page.get_by_test_id("recording")).to_contain_text("Replay")
    page.get_by_role("button", name="Back to live").click()
    expect(page.get_by_role("region", name="Replay")).to_be_hidden()


def test_a_session_can_be_looked_at_while_it_is_recorded(service, open_page):
    page = open_page(f"{service.base_url}/#/sessions")
    page.get_by_test_id("sessions").get_by_role("link", name=re.compile("^20")).first.click()
    expect(page.locator("canvas")).to_have_count(7)


def test_a_moment_is_marked_by_key_and_a_file_of_another_system_is_brought_in(make_service, open_page, tmp_path):
    service = make_service("--seed", "5")
    service.wait_for(lambda s: s["recording"] and s["recording"]["frames"] > 20)
    page = open_page(f"{service.base_url}/#/overview")
    expect(page.get_by_test_id("recording")).to_contain_text(re.compile(r"\d\d:\d\d"))
    page.keyboard.press("k")
    page.get_by_role("button", name="Driver change").click()
    page.get_by_label("Marker text").fill("Anna")
    page.keyboard.press("Enter")
    expect(page.get_by_test_id("mark")).to_have_count(0)
    with service.client() as client:
        session_id = client.get("/sessions").json()["sessions"][0]["id"]
        marker = client.get(f"/sessions/{session_id}/markers").json()["markers"][-1]
    assert (marker["kind"], marker["text"]) == ("driver", "Anna")
    page.goto(f"{service.base_url}/#/sessions/{session_id}/export")
    page.get_by_text("candump").first.click()
    with page.expect_download() as download:
        page.get_by_test_id("take").click()
    assert download.value.suggested_filename == f"{session_id}-simulated.log"
    rows = "\n".join(f"{i / 10},12,3.7,3.71" for i in range(50))
    (tmp_path / "theirs.csv").write_text(f"t,I,Cell 1 [V],Cell 2 [V]\n{rows}\n")
    first_look = []  # what the page asks when it opens is answered after the import has begun
    page.route(re.compile("/imports$"), lambda route: first_look.append(route), times=1)
    with page.expect_request(re.compile("/imports$")):
        page.goto(f"{service.base_url}/#/sessions/import")
    page.get_by_test_id("import-file").set_input_files(tmp_path / "theirs.csv")
    preview = page.get_by_test_id("import-preview")
    expect(preview.locator("tbody tr").first).to_contain_text("12.00")
    page.get_by_test_id("import-cells").fill("7")
    expect(preview.get_by_role("alert")).to_contain_text("no cell 7")
    page.get_by_test_id("import-cells").fill("")
    preview.get_by_role("button", name="2 3.710").click()
    expect(page.get_by_test_id("import-cells")).to_have_value("1")
    expect(preview).to_contain_text("1 of 2 cells used")
    expect(preview).not_to_contain_text("means over each row")
    page.get_by_test_id("current-means").select_option("yes")
    expect(preview).to_contain_text("means over each row")
    with page.expect_response(re.compile(r"/imports/\d+$")):
        page.get_by_test_id("import").click()
    first_look[0].fulfill(json={"last": None, "profiles": []})
    page.get_by_role("link", name="theirs.csv imported").click()
    expect(page.get_by_role("heading", name="theirs.csv")).to_be_visible()


def test_a_time_without_a_unit_is_asked_for(service, open_page, tmp_path):
    rows = "\n".join(f"{2000 * i},12,3.7,3.71" for i in range(50))
    (tmp_path / "ms.csv").write_text(f"Time,Current (A),Cell 1 (V),Cell 2 (V)\n{rows}\n")
    page = open_page(f"{service.base_url}/#/sessions/import")
    page.get_by_test_id("import-file").set_input_files(tmp_path / "ms.csv")
    preview = page.get_by_test_id("import-preview")
    expect(preview.get_by_role("alert")).to_contain_text("Time has no unit")
    expect(page.get_by_test_id("unit-time")).to_have_value("")
    page.get_by_test_id("unit-time").select_option("ms")
    expect(preview).to_contain_text("01:38")
    expect(preview).to_contain_text("no date in the file")
    page.get_by_test_id("import-start").fill("2026-07-14T10:30")
    page.get_by_test_id("import").click()
    page.get_by_role("link", name="ms.csv imported").click()
    with service.client() as client:
        listed = client.get("/sessions").json()["sessions"]
    [started_s] = [session["started"] for session in listed if session["name"] == "ms.csv"]
    local_s = page.evaluate("new Date('2026-07-14T10:30').getTime() / 1000")
    assert started_s == local_s


def test_a_season_is_asked_in_sql(service, open_page):
    page = open_page(f"{service.base_url}/#/season")
    page.get_by_test_id("sql").fill("SELECT 7 AS n, 'seven' AS text")
    page.get_by_test_id("sql-ask").click()
    expect(page.get_by_test_id("sql-answer").locator("tbody tr")).to_have_text(["7seven"], timeout=60_000)
