"""`voltwall season swap`: a swap is listed with its car, and taken back."""

import json
import re

import numpy as np
import pytest

from app.cli import main
from tests.recorded.arrays import START_S, SessionMaker


@pytest.fixture
def data(tmp_path):
    """The data folder of two cars with a session each."""
    make = SessionMaker(tmp_path / "sessions")
    for day, car in enumerate(("red", "blue")):
        make(np.arange(20.0), np.zeros(20), start_s=START_S + day * 86400.0, metadata={"car": car})
    return ["--data", str(tmp_path)]


def test_a_swap_is_of_the_car_that_is_named_and_is_taken_back(data, capsys):
    command = ["season", "swap", *data]
    assert main([*command, "3/7"]) == 2
    assert re.search("car.*blue.*red", capsys.readouterr().err)
    at = ["--at", "2026-09-21T10:00", "--note", "spare box"]
    assert main([*command, "3/8,3/7", *at, "--car", "red"]) == 0
    assert capsys.readouterr().out == "swap 1: 3/7, 3/8 of red replaced 2026-09-21 10:00Z: spare box\n"
    assert main([*command, "--car", "blue"]) == 0
    assert capsys.readouterr().out == ""
    assert main([*command, "--json"]) == 0
    (swap,) = json.loads(capsys.readouterr().out)
    assert (swap["cells"], swap["car"]) == ([30, 31], "red")
    assert main([*command, "--take-back", "1"]) == 0
    assert capsys.readouterr().out == ""
    assert main([*command, "--take-back", "1"]) == 2
    assert "a swap that is listed" in capsys.readouterr().err


@pytest.mark.parametrize(("words", "said"), [(["9/1"], "1/1 to 8/12"), (["3/7", "--at", "noon"], "--at = noon")])
def test_what_is_no_cell_or_no_time_is_refused(data, capsys, words, said):
    assert main(["season", "swap", *data, *words]) == 2
    assert said in capsys.readouterr().err
