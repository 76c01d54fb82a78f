"""The simulated car's page: what happens is shown, faults come and go, mistakes are named."""

import os
import re
import signal
from pathlib import Path

import pytest
from playwright.sync_api import expect


@pytest.mark.parametrize("size", ["desktop", "phone"])
def test_a_fault_comes_into_force_reaches_the_cell_and_is_cleared(service, open_page, size):
    page = open_page(f"{service.base_url}/#/simulator", size, quiet=False)  # the browser logs a refusal
    expect(page.get_by_test_id("simulator-scenario")).to_have_text("race-day")
    expect(page.get_by_test_id("scenario-clean-endurance")).to_contain_text("Nothing may trip")

    page.get_by_test_id("fault-kind").select_option("joint-resistance-high")
    page.get_by_label("Value").fill("51")
    page.get_by_test_id("inject").click()
    expect(page.get_by_test_id("simulator-problem")).to_contain_text("0..50 mΩ")
    expect(page.get_by_test_id("fault-joint-resistance-high")).to_have_count(0)

    page.get_by_test_id("fault-kind").select_option("external-heating")
    page.get_by_label("pack", exact=True).fill("3")
    page.get_by_label("cell", exact=True).fill("7")
    page.get_by_label("Value").fill("500")
    page.get_by_test_id("inject").click()
    fault = page.get_by_test_id("fault-external-heating")
    expect(fault).to_contain_text("pack 3, cell 7 · 500 W · until cleared")
    service.wait_for(lambda s: s["accumulator"]["temperature_max_cell"] == 30)
    page.get_by_role("button", name="Clear external-heating pack 3, cell 7").click()
    expect(fault).to_have_count(0)
    with service.client() as client:
        assert client.get("/simulator").json()["status"]["active"] == []


def assert_other_cells_are_one_command_away(page):
    page.get_by_test_id("cells-packs").fill("3")
    page.get_by_test_id("cells-each").fill("201")
    expect(page.get_by_test_id("number-of-cells")).to_contain_text("1 to 600 cells in total")
    page.get_by_test_id("cells-each").fill("14")
    expect(page.get_by_test_id("number-of-cells")).to_contain_text("8 × 12 cells")
    told = page.get_by_test_id("cells-command").or_(page.get_by_test_id("cells-start"))
    expect(told).to_contain_text(re.compile("--battery 3x14 --scenario race-day|Restart with these cells"))


def assert_circuits_are_compared_beside_the_thesis(page):
    page.get_by_test_id("balancing-whose").select_option("thesis")
    page.get_by_test_id("balancing-circuit").select_option("transformer")
    page.get_by_test_id("balancing-rate").fill("7")
    page.get_by_test_id("balancing-simulate").click()
    expect(page.get_by_test_id("balancing")).to_contain_text("0.05 to 6 C")
    page.get_by_test_id("balancing-rate").fill("3")
    page.get_by_test_id("balancing-simulate").click()
    expect(page.get_by_test_id("balancing-transformer")).to_contain_text("end current")
    told = page.get_by_test_id("balancing")
    expect(told.get_by_role("row", name="thesis result")).to_contain_text("1.41 h")
    expect(told.get_by_text("SOC spread (max − min)")).to_be_visible()


def test_an_alarm_follows_a_lost_slave_all_faults_are_cleared_at_once_and_another_scenario_starts(service, open_page):
    page = open_page(f"{service.base_url}/#/simulator", quiet=False)
    page.get_by_test_id("fault-kind").select_option("slave-lost")
    page.get_by_label("pack", exact=True).fill("6")
    page.get_by_test_id("inject").click()
    expect(page.get_by_test_id("fault-slave-lost")).to_contain_text("pack 6")
    expect(page.get_by_test_id("alarms")).not_to_contain_text(re.compile(r"^\s*0"))
    expect(page).to_have_title(re.compile(r"^\d+ (to watch|warning|trip).* · Simulator"))
    page.get_by_test_id("clear-all").click()
    expect(page.get_by_test_id("fault-slave-lost")).to_have_count(0)

    assert_other_cells_are_one_command_away(page)
    assert_circuits_are_compared_beside_the_thesis(page)
    page.get_by_role("button", name=re.compile("^Start.* skid-pad$")).click()
    page.get_by_role("dialog").get_by_role("button", name="Start", exact=True).click()
    expect(page.get_by_test_id("simulator-scenario")).to_have_text("skid-pad")


def children_of(pid: int) -> list[int]:
    """Return the processes that a process started and that still are: of a service the simulated car."""
    return [int(child) for path in Path(f"/proc/{pid}/task").glob("*/children") for child in path.read_text().split()]


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="no process can be found here")
def test_a_car_that_does_not_answer_is_told_and_shows_no_value(service, open_page):
    page = open_page(f"{service.base_url}/#/simulator", quiet=False)
    running = page.locator("dd", has_text=re.compile(r"^running$"))
    expect(running).to_have_count(1)
    children = children_of(service.process.pid)
    for child in children:
        os.kill(child, signal.SIGSTOP)
    try:
        expect(page.get_by_test_id("simulator-gone")).to_contain_text("No response from the simulated car since")
        expect(running).to_have_count(0)
        expect(page.get_by_text("No active faults.")).to_have_count(0)
        expect(page.get_by_test_id("inject")).to_be_disabled()
    finally:
        for child in children:
            os.kill(child, signal.SIGCONT)
    expect(page.get_by_test_id("simulator-gone")).to_have_count(0)
    expect(running).to_have_count(1)
