"""`voltwall simulate` by itself: the library, a description, a scenario played as fast as it goes."""

import pytest

from simulator.cli import main
from simulator.scenario import find_scenario, library


def test_list_names_the_library_with_titles(capsys):
    assert main(["--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == [scenario.name for scenario in library()]
    assert all(scenario.title in line for scenario, line in zip(library(), lines, strict=True))


def test_describe_tells_start_phases_faults_and_outcome(capsys):
    assert main(["--describe", "broken-converter"]) == 0
    text = capsys.readouterr().out
    assert find_scenario("broken-converter").title in text
    for part in ("starts at 70%", "idle", "broken-converter in pack 4", "TRIP_SENSOR_LOST"):
        assert part in text


def test_an_unknown_scenario_is_one_line(capsys):
    assert main(["--describe", "no-such"]) == 1
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("speed", ["0", "-1", "fast", "nan"])
def test_a_speed_that_is_none_is_refused(speed):
    with pytest.raises(SystemExit):
        main(["--speed", speed])
