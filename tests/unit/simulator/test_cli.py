"""`voltwall simulate` by itself: the library, a description, a scenario played as fast as it goes."""

import json
import time
import tomllib

import pytest

from simulator.cli import main
from simulator.errors import ScenarioError
from simulator.library import LIBRARY, find_scenario, library
from simulator.scenario_file import load_scenario


def test_list_names_the_library_with_titles(capsys):
    assert main(["--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == [scenario.name for scenario in library()[0]]
    assert all(scenario.title in line for scenario, line in zip(library()[0], lines, strict=True))


def test_list_as_json_tells_what_the_files_say(capsys):
    assert main(["--list", "--json"]) == 0
    listed = {each.pop("name"): each for each in json.loads(capsys.readouterr().out)}
    files = {path.stem: tomllib.loads(path.read_text()) for path in LIBRARY.glob("*.toml")}
    assert listed.keys() == files.keys()
    for name, file in files.items():
        times = [phase.get("for_s") for phase in file["phase"]]
        seconds = None if None in times else sum(times)
        assert listed[name] == {"title": file["title"], "seconds": seconds, "loop": file.get("loop", False)}, name
    assert listed["race-day"]["seconds"] is None  # its race ends by itself
    assert listed["thesis-soft"]["seconds"] == 900


def test_json_without_a_list_is_refused(capsys):
    for words in (["--json"], ["--json", "--describe", "race-day"]):
        assert main(words) == 2
        told = capsys.readouterr()
        assert (told.out, told.err) == ("", "voltwall simulate: --json goes with --list\n")


def test_describe_tells_start_phases_faults_and_outcome(capsys):
    assert main(["--describe", "broken-converter"]) == 0
    text = capsys.readouterr().out
    assert find_scenario("broken-converter").title in text
    for part in ("starts at 70%", "idle", "slave-adc-fault in pack 4", "TRIP_SENSOR_LOST"):
        assert part in text


def test_an_unknown_scenario_is_one_line(capsys):
    assert main(["--describe", "no-such"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_as_fast_as_possible_outruns_the_clock(capsys):
    begin_s = time.monotonic()
    assert main(["--scenario", "skid-pad", "--speed", "max", "--duration", "60"]) == 0
    assert time.monotonic() - begin_s < 30.0
    assert capsys.readouterr().out == "ready\n"


def test_an_unreadable_file_of_the_library_is_named_beside_the_others(capsys, tmp_path, monkeypatch):
    (tmp_path / "bad.toml").write_text("[[phase]]\n")
    monkeypatch.setattr("simulator.library.library", lambda **of: library(tmp_path, **of))
    assert main(["--list"]) == 0
    assert "bad.toml" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("option", "value", "limit"),
    [
        *(("--speed", value, "0.01..1e+06") for value in ("0", "-1", "fast", "nan")),
        *(
            ("--seed", value, "the whole numbers 0..4294967295")
            for value in ("-1", "1.5", "4294967296", "x", "9" * 5000)
        ),
        *(("--duration", value, "0..100000000 s (0 left out)") for value in ("-5", "0", "nan", "inf", "x")),
    ],
    ids=lambda text: text[:20],
)
def test_an_option_that_makes_no_sense_is_refused_with_its_limit(capsys, option, value, limit):
    with pytest.raises(SystemExit):
        main([f"{option}={value}"])
    last = capsys.readouterr().err.splitlines()[-1]
    assert f"argument {option}: " in last
    assert limit in last


@pytest.mark.parametrize("option", ["--control=99999", "--serial=tcp:99999", f"--serial=tcp:{'9' * 5000}"], ids=len)
def test_a_port_that_is_none_is_one_line(capsys, option):
    assert main([option]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_an_action_that_the_master_refuses_is_told(capsys, tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(
        'title = "t"\ndescription = "d"\n[[phase]]\nload = "idle"\nfor_s = 4\n'
        '[[action]]\nat_s = 3\nname = "charge-start"\n'
    )
    assert main(["--scenario", str(path), "--speed", "max"]) == 0
    told = capsys.readouterr().err.splitlines()
    assert told[-1] == "voltwall simulate: at 3 s: charge-start rejected by the master in its present state"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("a = " + "[" * 100_000, "recursion"),
        ("a = " + "9" * 60_000, "digits"),
        (".".join("a" * 100_000) + " = 1", "more than 8 parts"),
        ("#" * 300_000, "at most 262144"),
    ],
)
def test_a_hostile_scenario_is_one_error_with_its_file(tmp_path, text, reason):
    file = tmp_path / "hostile.toml"
    file.write_text(text)
    with pytest.raises(ScenarioError, match=rf"hostile\.toml.*{reason}"):
        load_scenario(file)
