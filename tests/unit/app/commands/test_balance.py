import json

import pytest

from app.cli import main

SMALL = ["balance", "--segments", "1x3", "--rest", "--hours", "0.2"]


def test_it_prints_a_line_for_each_circuit_and_what_was_simulated(capsys):
    assert main([*SMALL, "--spread", "4"]) == 0
    title, heads, *lines = capsys.readouterr().out.splitlines()
    assert title == "3 cells of the car (1x3), rest, air of 25 degC, SOC 88.0 to 92.0 %, 23.5 ohm"
    assert heads.split() == ["hours", "hottest", "left", "in", "a", "pack", "lost", "ended", "by"]
    assert [line.split()[0] for line in lines] == ["passive", "switched-capacitor", "transformer", "none"]
    assert lines[-1].split() == ["none", "0.20", "25.0", "degC", "4.000", "%", "4.000", "%", "0.00", "Wh", "time"]


def test_the_thesis_is_told_beside_the_run(capsys):
    assert main(["balance", "--thesis", "--rate", "2", "--resistor", "40", "--circuit", "passive"]) == 0
    _, _, ours, theirs = capsys.readouterr().out.splitlines()
    assert ours.startswith("passive")
    assert theirs.split() == ["in", "the", "thesis", "1.20", "34.0", "degC", "0.030", "%"]


def test_json_holds_figures_and_courses(capsys):
    arguments = ["--circuit", "passive", "--soc", "50", "--until", "1", "--temperature", "30", "--seed", "4", "--json"]
    assert main([*SMALL, *arguments]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["study"] | {"start_soc": None} == {
        "cells": "car", "n_packs": 1, "per_pack": 3, "rate_c": None, "hours": 0.2, "soc": 0.5, "spread": 0.02,
        "ambient_degc": 30.0, "resistor_ohm": 23.5, "threshold_v": 1e-3, "until": 0.01, "seed": 4, "start_soc": None,
    }  # fmt: skip
    passive = told["circuits"]["passive"]
    course = passive["course"]
    assert course["soc_max"][-1] - course["soc_min"][-1] == pytest.approx(passive["soc_difference"])
    assert course["time_h"][-1] == passive["hours"]
    assert {len(values) for values in course.values()} == {len(course["time_h"])}
    assert passive["thesis"] is None


@pytest.mark.parametrize(("kind", "panels"), [(["--rest"], 2), (["--rate", "6", "--soc", "90"], 3)])
def test_it_draws_the_courses(tmp_path, capsys, kind, panels):
    pytest.importorskip("matplotlib")
    picture = tmp_path / "balance.svg"
    assert main(["balance", "--segments", "1x2", "--hours", "0.1", *kind, "--picture", str(picture)]) == 0
    drawn = picture.read_text()
    assert drawn.count('<g id="axes_') == panels
    assert "transformer" in drawn


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--picture", "/no/such/folder/x.svg"], "/no/such/folder/x.svg"),
        (["--soc", "0", "--spread", "2"], "spread"),
        (["--segments", "60x12"], "720"),
    ],
)
def test_what_cannot_be_simulated_or_drawn_is_named(arguments, named, capsys):
    assert main(["balance", *arguments]) == 2
    assert named in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments", [["--rate", "7"], ["--spread", "-1"], ["--segments", "8"], ["--rate", "1", "--rest"]]
)
def test_a_wrong_option_is_refused_with_its_limits(arguments, capsys):
    with pytest.raises(SystemExit):
        main(["balance", *arguments])
    assert arguments[0] in capsys.readouterr().err
