import pytest

from firmware_protocol.config_image import unit_value
from firmware_protocol.messages import EventCode
from simulator.errors import ScenarioError
from simulator.library import DEFAULT_SCENARIO, find_scenario, library
from simulator.scenario import load_scenario

GOOD = """
title = "A title"
description = "A description."
seed = 5

[start]
soc = 0.5
[start.cells]
"2/1" = 0.6

[config]
v_cell_max = 4.15

[[phase]]
load = "constant"
current_a = 20
for_s = 60

[[fault]]
at_s = 10
name = "loose-joint"
pack = 3
cell = 7
value = 2

[[expect]]
event = "TRIP_SLAVE_LOST"
pack = 2
before_s = 50
"""


def write(folder, text):
    path = folder / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_file_is_read_as_people_wrote_it(tmp_path):
    scenario = load_scenario(write(tmp_path, GOOD))
    assert (scenario.name, scenario.title, scenario.seed, scenario.loop) == ("mine", "A title", 5, False)
    assert scenario.start.cells == {"12": 0.6}
    assert unit_value(scenario.config, "v_cell_max") == 4.15
    assert (scenario.faults[0].name, scenario.faults[0].target) == ("loose-joint", 30)
    assert (scenario.expected[0].event, scenario.expected[0].cell) == (EventCode.TRIP_SLAVE_LOST, 12)


@pytest.mark.parametrize(
    ("before", "after", "reason"),
    [
        ('title = "A title"', "", "title is missing"),
        ("seed = 5", "sead = 5", "'sead' means nothing"),
        ("soc = 0.5\n", "sock = 0.5\n", r"\[start\].*'sock'"),
        ('"2/1" = 0.6', '"9/1" = 0.6', "packs are 1..8"),
        ("v_cell_max = 4.15", "v_cell_max = 9", "v_cell_max"),
        ("v_cell_max = 4.15", "v_cell_min = 4.0\nv_cell_max = 3.9", "v_cell_min"),
        ('load = "constant"', 'load = "rocket"', "'rocket' is none of"),
        ('name = "loose-joint"', 'name = "loose-screw"', "no such fault"),
        ("cell = 7\n", "", "needs cell and pack"),
        ("value = 2", "value = 2000", "outside 0..50 mohm"),
        ("at_s = 10", 'at_s = "ten"', "no number"),
        ('event = "TRIP_SLAVE_LOST"', 'event = "BANG"', "'BANG' is none of"),
        ("[[phase]]", "[phase]", r"written as \[\[phase\]\]"),
        ("[[phase]]", "[[phase", "mine.toml"),
    ],
)
def test_what_makes_no_sense_is_refused_with_its_place(tmp_path, before, after, reason):
    assert before in GOOD
    with pytest.raises(ScenarioError, match=reason):
        load_scenario(write(tmp_path, GOOD.replace(before, after, 1)))


def test_library_has_what_the_default_needs_and_reads_back():
    scenarios, _ = library()
    assert len(scenarios) >= 15
    assert DEFAULT_SCENARIO in {scenario.name for scenario in scenarios}
    assert all(scenario.title in scenario.describe() for scenario in scenarios)


def test_a_name_that_is_neither_file_nor_scenario_lists_what_there_is(tmp_path):
    with pytest.raises(ScenarioError, match="clean-endurance"):
        find_scenario("nothing-like-it")
    with pytest.raises(ScenarioError):
        find_scenario("../scenarios/race-day")
    assert find_scenario(str(write(tmp_path, GOOD))).name == "mine"
