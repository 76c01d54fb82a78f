import json

from simulator.control import Control
from simulator.library import find_scenario, library
from simulator.runner import Runner
from simulator.scenario_player import ScenarioPlayer

GOOD = 'title = "Mine"\ndescription = "d"\n[[phase]]\nload = "rest"\n'


def test_the_library_itself_is_all_readable():
    assert library()[1] == []


def test_bad_files_are_named_with_their_reason_and_the_others_are_there(tmp_path):
    (tmp_path / "a.toml").write_text(GOOD)
    (tmp_path / "broken.toml").write_text("title = \n")
    (tmp_path / "empty.toml").write_text('title = "t"\ndescription = "d"\n')
    (tmp_path / "text.toml").write_bytes(b"\xff\xfe")
    (tmp_path / "folder.toml").mkdir()
    scenarios, unreadable = library(tmp_path)
    assert [scenario.title for scenario in scenarios] == ["Mine"]
    assert [file.name for file in unreadable] == ["broken.toml", "empty.toml", "folder.toml", "text.toml"]
    assert "no [[phase]]" in unreadable[1].reason
    assert not any(str(tmp_path) in file.reason for file in unreadable)


def test_a_changed_file_is_read_again(tmp_path):
    path = tmp_path / "a.toml"
    path.write_text(GOOD)
    assert library(tmp_path)[0][0].title == "Mine"
    path.write_text(GOOD.replace("Mine", "Other"))
    assert library(tmp_path)[0][0].title == "Other"


def test_the_control_port_lists_the_good_ones_and_names_the_bad_one(tmp_path, monkeypatch):
    (tmp_path / "a.toml").write_text(GOOD)
    (tmp_path / "bad.toml").write_text(GOOD.replace("rest", "sleep"))
    player = ScenarioPlayer(find_scenario("skid-pad"))
    monkeypatch.setattr("simulator.control.library", lambda **of: library(tmp_path, **of))
    answer = Control(player, Runner(player.simulation)).answer({"do": "scenarios"})
    assert answer["ok"]
    assert [item["name"] for item in answer["scenarios"]] == ["a"]
    assert [item["name"] for item in answer["unreadable"]] == ["bad.toml"]
    assert "'sleep'" in json.dumps(answer["unreadable"])
