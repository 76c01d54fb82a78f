import pytest

from firmware_protocol.config_image import unit_value
from firmware_protocol.messages import EventCode
from simulator.cli import DEFAULT_SCENARIO
from simulator.errors import ScenarioError
from simulator.library import find_scenario, library
from simulator.loads import PATTERNS_C
from simulator.scenario_file import load_scenario

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
name = "joint-resistance-high"
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
    assert (scenario.faults[0].name, scenario.faults[0].target) == ("joint-resistance-high", 30)
    assert (scenario.expected[0].event, scenario.expected[0].cell) == (EventCode.TRIP_SLAVE_LOST, 12)


@pytest.mark.parametrize(
    ("before", "after", "reason"),
    [
        ('title = "A title"', "", "title is missing"),
        ("seed = 5", "sead = 5", "'sead' means nothing"),
        ("soc = 0.5\n", "sock = 0.5\n", r"\[start\].*'sock'"),
        ('"2/1" = 0.6', '"9/1" = 0.6', "pack = 9 is outside 1..8"),
        ("[config]", '[balancing]\nmethod = "magic"\n[config]', r"\[balancing\].*'magic' is none of"),
        ("[config]", "[balancing]\nrate = 2\n[config]", r"\[balancing\].*'rate' means nothing"),
        ("[config]", "[slaves]\nsensors = 2\n[config]", r"\[slaves\].*'sensors' means nothing"),
        ("[config]", "[slaves]\nsensor_inputs = 2\n[config]", r"\[slaves\].*= 2 is not each of 1..12 once"),
        ("[config]", f"[slaves]\nsensor_inputs = {[1] * 12}\n[config]", r"is not each of 1..12 once"),
        ("[config]", f"[slaves]\nsensor_inputs = [true, {'2, ' * 11}]\n[config]", r"is not each of 1..12 once"),
        ("v_cell_max = 4.15", "v_cell_max = 9", "v_cell_max"),
        ("v_cell_max = 4.15", "v_cell_min = 4.0\nv_cell_max = 3.9", "v_cell_min"),
        ('load = "constant"', 'load = "rocket"', "'rocket' is none of"),
        ('name = "joint-resistance-high"', 'name = "loose-screw"', "'loose-screw' is none of"),
        ("cell = 7\n", "", "needs pack and cell"),
        ("value = 2", "value = 2000", "outside 0..50 mohm"),
        ("at_s = 10", 'at_s = "ten"', "no number"),
        ('event = "TRIP_SLAVE_LOST"', 'event = "BANG"', "'BANG' is none of"),
        ("[[phase]]", "[phase]", r"written as \[\[phase\]\]"),
        ("[[phase]]", "[[phase", "mine.toml"),
        ("seed = 5", "seed = 1.5", r"seed = 1\.5 is outside the whole numbers 0\.\.4294967295"),
        ("seed = 5", "seed = -1", "seed = -1 is outside"),
        ("seed = 5", "seed = inf", "seed = inf is outside"),
        ("seed = 5", 'seed = 5\nloop = "no"', "loop = 'no' is neither true nor false"),
        ('title = "A title"', "title = 5", "title = 5 is no text"),
        ("soc = 0.5\n", "soc = 5\n", r"soc = 5 is outside 0\.\.1"),
        ("soc = 0.5\n", "soc = nan\n", "soc = nan is outside"),
        ("soc = 0.5\n", "soc_spread = -3\n", r"soc_spread = -3 is outside 0\.\.0\.25"),
        ("soc = 0.5\n", "capacity_spread = 0.5\n", r"capacity_spread = 0\.5 is outside 0\.\.0\.3"),
        ("soc = 0.5\n", "ambient_degc = -400\n", r"ambient_degc = -400 is outside -40\.\.80 degC"),
        ("soc = 0.5\n", "ambient_degc = nan\n", "ambient_degc = nan is outside"),
        ('"2/1" = 0.6', '"2/1" = 17', r'cells "2/1" = 17 is outside 0\.\.1'),
        ('"2/1" = 0.6', '"2/1" = true', 'cells "2/1" = True is no number'),
        ('"2/1" = 0.6', f'"{"9" * 5000}/1" = 0.6', 'write "pack/cell" = number'),
        ("current_a = 20", "current_a = 1e9", r"current_a = 1000000000\.0 is outside -1000\.\.1000 A"),
        ("current_a = 20", "current_a = nan", "current_a = nan is outside"),
        ("current_a = 20", f"current_a = {'9' * 401}", "current_a = 9{30}.* is outside"),
        ("current_a = 20", f"current_a = 0x{'f' * 5000}", "current_a = an integer of too many digits is outside"),
        ("current_a = 20", f"current_a = {'9' * 5000}", "mine.toml: "),
        ("current_a = 20\n", "", "current_a is missing"),
        ("for_s = 60", "for_s = -5", r"for_s = -5 is outside 0\.\.100000000 s \(0 left out\)"),
        ("for_s = 60", "for_s = nan", "for_s = nan is outside"),
        ("for_s = 60", "laps = 3", "'laps' means nothing with load 'constant'"),
        ('load = "constant"', 'load = "rest"', "'current_a' means nothing with load 'rest'"),
        ('load = "constant"\ncurrent_a = 20', 'load = "rest"\nuntil_soc = 0.3', "'until_soc' means nothing"),
        ('load = "constant"\ncurrent_a = 20', 'load = "idle"\nfile = "a.csv"', "'file' means nothing"),
        (
            'load = "constant"\ncurrent_a = 20',
            'load = "endurance"\nlaps = 0',
            r"laps = 0 is outside the whole numbers 1\.\.",
        ),
        ('load = "constant"\ncurrent_a = 20', 'load = "endurance"\nlaps = 2.5', r"laps = 2\.5 is outside"),
        ('load = "constant"\ncurrent_a = 20', 'load = "pattern"\npattern = "brutal"', "'brutal' is none of hard"),
        ('load = "constant"\ncurrent_a = 20', 'load = "pattern"\npattern = []', "0 slices; 1 to 200"),
        (
            'load = "constant"\ncurrent_a = 20',
            'load = "pattern"\npattern = [4, 11]',
            r"pattern\[1\] = 11 is outside -10\.\.10 C",
        ),
        ('load = "constant"\ncurrent_a = 20', 'load = "pattern"\npattern = [4, "x"]', r"pattern\[1\]"),
        ('load = "constant"\ncurrent_a = 20', 'load = "pattern"\npattern = [2, -2]', "it has to discharge"),
        ('load = "constant"\ncurrent_a = 20', 'load = "recorded"', "file is missing"),
        ('load = "constant"\ncurrent_a = 20', 'load = "recorded"\nfile = "no.csv"', r"no\.csv"),
        ('load = "constant"\ncurrent_a = 20', 'load = "recorded"\nfile = "a\\u0000b"', "null byte"),
        ("at_s = 10", "at_s = -5", r"at_s = -5 is outside 0\.\."),
        ("at_s = 10", "at_s = nan", "at_s = nan is outside"),
        ("pack = 3", "pack = 3.7", r"pack = 3\.7 is outside the whole numbers 1\.\.8"),
        ("pack = 3", "pack = inf", "pack = inf is outside"),
        ("pack = 2\n", "cell = 2\n", "needs pack and cell"),
        ("before_s = 50", "after_s = 60\nbefore_s = 50", "before_s = 50 is before after_s = 60"),
        ("[[expect]]", '[[action]]\nname = "soc"\nargument = 50\n[[expect]]', r"argument = 50 is outside 0\.\.1"),
        ("[[expect]]", '[[action]]\nname = "soc"\nargument = nan\n[[expect]]', "argument = nan is outside"),
        ("[[expect]]", '[[action]]\nname = "soc"\n[[expect]]', "argument is missing"),
        ("[[expect]]", '[[action]]\nname = "reset"\nargument = 1\n[[expect]]', "'argument' means nothing with 'reset'"),
    ],
    ids=lambda text: text[:40],
)
def test_what_makes_no_sense_is_refused_with_its_place(tmp_path, before, after, reason):
    assert before in GOOD
    with pytest.raises(ScenarioError, match=reason):
        load_scenario(write(tmp_path, GOOD.replace(before, after, 1)))


def test_resistors_balance_unless_the_file_says_otherwise(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(GOOD)
    assert load_scenario(path).balancing == "passive"
    path.write_text(GOOD + '[balancing]\nmethod = "transformer"\n')
    scenario = load_scenario(path)
    assert scenario.balancing == "transformer"
    assert "balances by transformer" in scenario.describe()


def test_the_sensors_sit_where_the_thesis_reads_them_unless_the_file_says_otherwise(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(GOOD)
    assert load_scenario(path).sensor_inputs == (0, 2, 4, 6, 8, 10, 1, 3, 5, 7, 9, 11)
    path.write_text(f"{GOOD}[slaves]\nsensor_inputs = {[*range(12, 0, -1)]}\n")
    assert load_scenario(path).sensor_inputs == tuple(range(11, -1, -1))


def test_a_later_phase_is_made_when_the_file_is_read(tmp_path):
    (tmp_path / "drive.csv").write_text("time_s,current_a\n0,10\n1,nan\n")
    text = GOOD.replace("[[fault]]", '[[phase]]\nload = "recorded"\nfile = "drive.csv"\n\n[[fault]]', 1)
    with pytest.raises(ScenarioError, match=r"mine\.toml \[\[phase\]\] 2: .*line 3: current_a = nan"):
        load_scenario(write(tmp_path, text))
    (tmp_path / "drive.csv").write_text("time_s,current_a\n0,10\n1,20\n")
    assert load_scenario(write(tmp_path, text)).phases[1].recording.duration_s == 1.0


def test_a_round_takes_at_most_what_its_phases_do_if_each_has_a_time(tmp_path):
    (tmp_path / "drive.csv").write_text("time_s,current_a\n0,10\n7,20\n")
    recorded = GOOD.replace("[[fault]]", '[[phase]]\nload = "recorded"\nfile = "drive.csv"\n\n[[fault]]', 1)

    def longest_s(text):
        return load_scenario(write(tmp_path, text)).longest_s

    assert longest_s(GOOD) == 60
    assert longest_s(GOOD.replace("for_s = 60", "for_s = 60\nuntil_soc = 0.2")) == 60
    assert longest_s(GOOD.replace("for_s = 60", "until_soc = 0.2")) is None
    assert longest_s(recorded) == 67
    assert longest_s(recorded.replace('"drive.csv"', '"drive.csv"\nfor_s = 5')) == 65
    assert longest_s(recorded.replace('"drive.csv"', '"drive.csv"\nfor_s = 50')) == 67
    assert longest_s(recorded.replace("for_s = 60", "until_soc = 0.2")) is None


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


def test_a_pattern_is_named_or_written_out(tmp_path):
    path = tmp_path / "mine.toml"
    for written, meant in (('"soft"', PATTERNS_C["soft"]), ("[4, 0, 6.5, -2]", (4.0, 0.0, 6.5, -2.0))):
        path.write_text(f'title = "x"\ndescription = "y"\n[[phase]]\nload = "pattern"\npattern = {written}\n')
        assert load_scenario(path).phases[0].pattern_c == meant
