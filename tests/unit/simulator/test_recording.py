import gzip

import pytest

from simulator.errors import ParameterError, ScenarioError
from simulator.library import find_scenario
from simulator.recording import load_recording, read_recording
from simulator.scenario_file import load_scenario
from simulator.scenario_player import ScenarioPlayer

OURS = "time_s,current_a,ambient_degc\n0,10,20\n1,20,21\n2,0,22\n"
EXPORTED = (
    "time_s,elapsed_s,uptime_s,i_fc (A),t_min (degC),soc\n"
    "1795232138.1,0.0,5.0,10.00,,0.83\n1795232138.2,0.1,,,25,\n1795232139.1,1.0,6.0,20.00,24,0.82\n"
    "1795232139.1,1.0,6.0,25.00,24,0.82\n1795232140.1,2.0,7.0,0.00,31,0.81\n"
)
WITHOUT_UNITS = EXPORTED.replace(" (A)", "").replace(" (degC)", "")  # by --names number


class Nothing:
    outlet_voltage_v = 350.0


@pytest.mark.parametrize("zipped", [False, True])
@pytest.mark.parametrize(("text", "second"), [(OURS, 20.0), (EXPORTED, 25.0), (WITHOUT_UNITS, 25.0)])
def test_a_recording_is_replayed_as_it_was(tmp_path, text, second, zipped):
    path = tmp_path / ("run.csv.gz" if zipped else "run.csv")
    path.write_bytes(gzip.compress(text.encode()) if zipped else text.encode())
    load = load_recording(path)
    assert [load.current_a(t_s, Nothing()) for t_s in (0.5, 1.5, 3.5)] == [10.0, second, 0.0]
    assert load.duration_s == pytest.approx(2.0)


def test_the_air_of_a_session_is_its_coldest_cell_so_far(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text(EXPORTED)
    recording = read_recording(path)
    assert recording.ambient_degc.tolist() == [24.0, 24.0, 24.0]
    assert recording.start_soc == 0.83


def test_measured_air_may_warm_and_is_held_over_gaps(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("time_s,current_a,ambient_degc\n0,1,\n1,1,20\n2,1,\n3,1,22\n")
    assert read_recording(path).ambient_degc.tolist() == [20.0, 20.0, 20.0, 22.0]


def test_what_a_recording_does_not_have_is_missing(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("time_s,current_a,ambient_degc\n0,1,\n1,1,\n")
    recording = read_recording(path)
    assert (recording.ambient_degc, recording.start_soc) == (None, None)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "needs time_s and one of current_a"),
        ("time_s,power\n1,2\n", "needs time_s and one of current_a"),
        ("time_s,current_a\n0,1\n", "two rows"),
        ("time_s,current_a\n0,a\n1,b\n", "line 2: current_a = 'a' is no number"),
        ("time_s,current_a\n0,1\n0,2\n", "two rows"),
        ("time_s,current_a\n\xff", "utf-8"),
        ("time_s,current_a\n0,1\n1,nan\n2,1\n", r"line 3: current_a = nan is outside -1000\.\.1000 A"),
        ("time_s,current_a\n0,1\n1,1e9\n", "line 3: current_a = "),
        ("time_s,current_a\n0,1\n,2\n", "line 3: time_s = '' is no number"),
        ("time_s,current_a\n0,1\ninf,2\n", "line 3: time_s = inf"),
        ("time_s,current_a\n0,1\n5,2\n3,2\n6,1\n", r"line 4: time_s = 3\.0 goes back, the row before has 5\.0"),
        ("time_s,current_a,soc\n0,1,95\n1,1,94\n", r"line 2: soc = 95\.0 is outside 0\.\.1"),
        ("time_s,current_a,ambient_degc\n0,1,20\n1,1,-400\n", r"line 3: ambient_degc = -400\.0 is outside -40\.\.80"),
    ],
)
def test_what_is_no_recording_is_refused_with_its_line(tmp_path, text, reason):
    path = tmp_path / "run.csv"
    path.write_text(text, encoding="latin-1")
    with pytest.raises(ParameterError, match=reason):
        load_recording(path)


def test_a_broken_sensor_of_a_session_is_not_taken_for_the_air(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("time_s,i_fc (A),t_min (degC)\n0,1,-60\n1,1,25\n2,1,-60\n3,1,24\n")
    assert read_recording(path).ambient_degc.tolist() == [25.0, 25.0, 25.0, 24.0]


@pytest.mark.parametrize("damage", [lambda raw: raw[:-9], lambda raw: raw[:12] + b"\xff\xff\xff" + raw[15:]])
def test_a_damaged_archive_is_refused(tmp_path, damage):
    path = tmp_path / "run.csv.gz"
    path.write_bytes(damage(gzip.compress(OURS.encode())))
    with pytest.raises(ParameterError):
        load_recording(path)


def test_a_scenario_replays_current_and_ambient(tmp_path):
    (tmp_path / "run.csv").write_text("time_s,current_a,ambient_degc\n0,60,20\n10,60,30\n20,60,40\n")
    scenario = tmp_path / "again.toml"
    scenario.write_text('title = "t"\ndescription = "d"\n[[phase]]\nload = "recorded"\nfile = "run.csv"\n')
    player = ScenarioPlayer(load_scenario(scenario))
    player.run(15.0)
    assert player.simulation.current_a == 60.0
    assert player.simulation.accumulator.ambient_degc == pytest.approx(35.0, abs=0.1)


def test_an_exported_session_is_a_scenario_by_itself(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text(EXPORTED)
    scenario = find_scenario(str(path))
    assert (scenario.start.soc, scenario.start.ambient_degc) == (0.83, 24.0)
    player = ScenarioPlayer(scenario)
    player.run(6.5)
    assert player.simulation.current_a == 25.0
    player.run(60.0)
    assert player.is_over


def test_a_scenario_may_start_from_a_recording_and_say_otherwise(tmp_path):
    (tmp_path / "run.csv").write_text(EXPORTED)
    (tmp_path / "again.toml").write_text(
        'title = "t"\ndescription = "d"\n[start]\nrecording = "run.csv"\nsoc = 0.5\n[[phase]]\nload = "rest"\n'
    )
    start = load_scenario(tmp_path / "again.toml").start
    assert (start.soc, start.ambient_degc) == (0.5, 24.0)
    (tmp_path / "run.csv").unlink()
    with pytest.raises(ScenarioError, match=r"run\.csv"):
        load_scenario(tmp_path / "again.toml")
