"""Batteries that are not the team's, simulated and read by their DBC: their pages in a real browser."""

import re

import pytest
from playwright.sync_api import expect

from tests.e2e.conftest import SIZES, is_too_wide
from tests.service_process import Service

SHAPES = {"fox": ("foxbms-2", [18] * 12), "small": (None, [14])}
BITS = 16


def small_battery(folder):
    """A profile of one segment of 14 cells and 7 temperature sensors, and its DBC; returns the profile's path."""
    messages = []
    for k in range(4):
        cells = [cell for cell in range(4 * k, 4 * k + 4) if cell < 14]
        lines = [
            f' SG_ Cell_{cell + 1}_V : {BITS * i}|{BITS}@1+ (0.001,0) [0|5] "V" BMS' for i, cell in enumerate(cells)
        ]
        messages.append("\n".join([f"BO_ {256 + k} Cells_{k}: 8 BMS", *lines]))
    degrees = [f' SG_ Temp_{i + 1} : {8 * i}|8@1+ (1,-40) [0|0] "degC" BMS' for i in range(7)]
    messages.append("\n".join(["BO_ 272 Temps: 8 BMS", *degrees]))
    messages.append('BO_ 273 Pack: 8 BMS\n SG_ Pack_Current : 0|16@1- (0.1,0) [0|0] "A" BMS')
    (folder / "small.dbc").write_text('VERSION ""\n\nNS_ :\n\nBS_:\n\nBU_: BMS\n\n' + "\n\n".join(messages) + "\n")
    profile = folder / "small.toml"
    profile.write_text(
        """[battery]
name = "small, 14 cells"
segments = [14]

[battery.temperatures]
sensors = 7
cells = "spread"

[source]
dbc = "small.dbc"

[[source.voltage]]
signal = "Cell_{cell}_V"
base = 1

[[source.temperature]]
signal = "Temp_{cell}"
base = 1

[source.current]
signal = "Pack_Current"
"""
    )
    return str(profile)


@pytest.fixture(scope="module", params=SHAPES)
def battery(request, tmp_path_factory):
    """A service of each battery, with the sizes of its segments."""
    name, segments = SHAPES[request.param]
    folder = tmp_path_factory.mktemp(request.param)
    service = Service(folder / "data", ["--battery", name or small_battery(folder)]).start()
    last = sum(segments) - 1
    service.wait_for(lambda s: s["cells"]["voltage_v"][last] is not None)
    yield service, segments
    service.stop()


def test_every_cell_has_its_number_on_the_map(battery, open_page):
    service, segments = battery
    page = open_page(f"{service.base_url}/#/packs")
    map_of_cells = page.get_by_test_id("heatmap")
    numbers = map_of_cells.locator(".cell .text").filter(has_text=re.compile(r"^[2-4]\.\d{3}$"))
    expect(numbers).to_have_count(sum(segments))
    assert not is_too_wide(page)
    box = map_of_cells.bounding_box()
    assert box["y"] + box["height"] <= 900  # nothing to scroll
    page.goto(f"{service.base_url}/#/overview")
    expect(numbers).to_have_count(sum(segments))
    if sum(segments) > 96:  # the prediction stands below it
        box = map_of_cells.bounding_box()
        assert box["y"] + box["height"] <= 900
    page.goto(f"{service.base_url}/#/packs")
    page.set_viewport_size(SIZES["phone"])
    expect(numbers).to_have_count(sum(segments))
    assert not is_too_wide(page)


def test_maps_say_what_a_sensor_stands_for_and_what_is_not_judged(battery, open_page):
    service, segments = battery
    page = open_page(f"{service.base_url}/#/packs")
    if sum(segments) > 100:  # foxBMS tells a tenth of its cells in one period
        page.get_by_test_id("metric-joint").click()
        expect(page.get_by_test_id("not-judged")).to_contain_text("40.0 % are needed")
    else:  # it has fewer sensors than cells
        page.get_by_test_id("metric-temperature").click()
        expect(page.get_by_test_id("sensors-key")).to_contain_text("7 sensors for 14 cells")
        expect(page.get_by_test_id("cell-1").locator(".text")).to_have_text("″")
        page.goto(f"{service.base_url}/#/packs/1/2")
        expect(page.get_by_test_id("cell-sensor")).to_have_text("sensor 1, also for pack 1, cell 1")


def test_pages_that_need_a_master_are_absent_and_the_others_hold_every_cell(battery, open_page):
    service, segments = battery
    page = open_page(f"{service.base_url}/#/system")
    expect(page.get_by_test_id("why-not-writable")).to_contain_text("Parameters, CAN tables and commands")
    expect(page.get_by_role("link", name="Parameters")).to_have_count(0)
    expect(page.get_by_role("link", name="Packs")).to_be_visible()
    page.goto(f"{service.base_url}/#/parameters")
    expect(page.get_by_text("Page not available for this battery")).to_be_visible()
    page.goto(f"{service.base_url}/#/charging")
    expect(page.get_by_role("heading", name="Charging", exact=True)).to_be_visible()
    expect(page.get_by_test_id("by-hand")).to_have_count(0)
    page.goto(f"{service.base_url}/#/can")
    expect(page.get_by_test_id("tab-trace")).to_be_visible()
    expect(page.get_by_test_id("tab-tx")).to_have_count(0)

    page.goto(f"{service.base_url}/#/judge")
    voltages = page.get_by_test_id("judge").locator("td .v")
    expect(voltages).to_have_count(sum(segments))
    overflow = "(all) => all.filter((v) => v.scrollWidth > v.parentElement.clientWidth).length"
    assert voltages.evaluate_all(overflow) == 0

    page.goto(f"{service.base_url}/#/packs/{len(segments)}/{segments[-1]}")
    expect(page.get_by_role("heading", name=f"pack {len(segments)}, cell {segments[-1]}")).to_be_visible()
    expect(page.get_by_test_id("cell-voltage")).to_contain_text(re.compile(r"[2-4]\.\d+"))
    page.keyboard.press("]")  # a cell is left by the keys
    expect(page.get_by_role("heading", name="pack 1, cell 1", exact=True)).to_be_visible()


def wide_battery(folder, n_cells, in_pack):
    """A profile of CAN FD frames with 32 cells each, and its DBC; returns the profile's path."""
    messages = []
    for first in range(0, n_cells, 32):
        cells = range(first, min(first + 32, n_cells))
        lines = [f' SG_ Cell_{c + 1}_V : {BITS * (c - first)}|{BITS}@1+ (0.001,0) [0|5] "V" BMS' for c in cells]
        messages.append("\n".join([f"BO_ {256 + first // 32} Cells_{first // 32}: 64 BMS", *lines]))
    messages.append('BO_ 512 Pack: 8 BMS\n SG_ Pack_Current : 0|16@1- (0.1,0) [0|0] "A" BMS')
    (folder / "wide.dbc").write_text('VERSION ""\n\nNS_ :\n\nBS_:\n\nBU_: BMS\n\n' + "\n\n".join(messages) + "\n")
    profile = folder / "wide.toml"
    profile.write_text(
        f'[battery]\nname = "wide"\nsegments = {[in_pack] * (n_cells // in_pack)}\n[battery.drawing]\nrows = 2\n'
        '[battery.temperatures]\nsensors = 0\n[source]\ndbc = "wide.dbc"\n'
        '[[source.voltage]]\nsignal = "Cell_{cell}_V"\nbase = 1\n[source.current]\nsignal = "Pack_Current"\n'
    )
    return str(profile)


@pytest.mark.parametrize(("n_cells", "in_pack"), [(240, 12), (600, 20)])
def test_240_cells_fit_the_map_without_scrolling_and_600_are_read_when_it_zooms(n_cells, in_pack, open_page, tmp_path):
    service = Service(tmp_path / "data", ["--battery", wide_battery(tmp_path, n_cells, in_pack)]).start()
    try:
        service.wait_for(lambda s: s["cells"]["voltage_v"][n_cells - 1] is not None)
        page = open_page(f"{service.base_url}/#/packs", quiet=False)  # a busy machine makes 600 cells late
        map_of_cells = page.get_by_test_id("heatmap")
        expect(map_of_cells.locator(".cell")).to_have_count(n_cells)
        box = map_of_cells.bounding_box()
        assert box["x"] + box["width"] <= 1440
        numbers = map_of_cells.locator(".cell .text").filter(has_text=re.compile(r"^[2-4]\.\d{3}$"))
        if n_cells <= 240:
            assert box["y"] + box["height"] <= 900
        else:
            expect(numbers).to_have_count(0)
            page.get_by_test_id("zoom-in").click()
        expect(numbers).to_have_count(n_cells)
    finally:
        service.stop()
