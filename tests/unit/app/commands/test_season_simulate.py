"""A season of simulated sessions: every session is a scenario that the simulator takes, of older and older cells."""

import argparse

import pytest

from app.commands.season import add_arguments
from app.commands.season_simulate import scenario_of
from app.errors import ConfigError
from simulator.scenario_file import load_scenario


def arguments(*more):
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    return parser.parse_args(["simulate", "--sessions", "3", "--days", "100", *more])


def test_the_cells_are_older_in_every_session(tmp_path):
    args = arguments("--use-ah", "30", "--pace", "3/7=4", "--drive-s", "60")
    starts = []
    for k in range(3):
        path = tmp_path / f"{k}.toml"
        path.write_text(scenario_of(k, args))
        scenario = load_scenario(path)
        starts.append(scenario.start)
        assert [phase.load for phase in scenario.phases] == ["rest", "endurance", "rest"]
    assert [start.aged_days for start in starts] == [0.0, 50.0, 100.0]
    assert [start.aged_ah for start in starts] == [0.0, 30.0, 60.0]
    assert starts[2].paces == {"30": 4.0}


@pytest.mark.parametrize("wrong", ["3/7", "3/7=", "3/7=x"])
def test_a_pace_that_is_none_is_named(wrong):
    with pytest.raises(ConfigError, match=r"PACK/CELL=TIMES"):
        scenario_of(0, arguments("--pace", wrong))
