import pytest

from simulator.director import Director
from simulator.errors import ParameterError
from simulator.recording import load_recording
from simulator.scenario import load_scenario

OURS = "time_s,current_a,ambient_degc\n0,10,20\n1,20,21\n2,0,22\n"
EXPORTED = (
    "time_s,elapsed_s,uptime_s,i_fc (A),soc\n"
    "1795232138.1,0.0,5.0,10.00,0.9\n1795232138.2,0.1,,,\n1795232139.1,1.0,6.0,20.00,0.9\n"
    "1795232139.1,1.0,6.0,25.00,0.9\n1795232140.1,2.0,7.0,0.00,0.9\n"
)


class Nothing:
    outlet_voltage_v = 350.0


@pytest.mark.parametrize(("text", "second"), [(OURS, 20.0), (EXPORTED, 25.0)])
def test_a_recording_is_replayed_as_it_was(tmp_path, text, second):
    path = tmp_path / "run.csv"
    path.write_text(text)
    load = load_recording(path)
    assert [load.current_a(t_s, Nothing()) for t_s in (0.5, 1.5, 3.5)] == [10.0, second, 0.0]
    assert load.duration_s == pytest.approx(2.0)


@pytest.mark.parametrize("text", ["", "time_s,power\n1,2\n", "time_s,current_a\n0,1\n", "time_s,current_a\n0,a\n1,b\n"])
def test_what_is_no_recording_is_refused(tmp_path, text):
    path = tmp_path / "run.csv"
    path.write_text(text)
    with pytest.raises(ParameterError):
        load_recording(path)


def test_a_scenario_replays_current_and_ambient(tmp_path):
    (tmp_path / "run.csv").write_text("time_s,current_a,ambient_degc\n0,60,20\n10,60,30\n20,60,40\n")
    scenario = tmp_path / "again.toml"
    scenario.write_text('title = "t"\ndescription = "d"\n[[phase]]\nload = "recorded"\nfile = "run.csv"\n')
    director = Director(load_scenario(scenario))
    director.run(15.0)
    assert director.simulation.current_a == 60.0
    assert director.simulation.accumulator.ambient_degc == pytest.approx(35.0, abs=0.1)
