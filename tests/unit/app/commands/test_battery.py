import json
import threading

import can
import pytest

from app.battery.library import bundled_profiles, load_profile
from app.cli import main
from tests.peer_batteries import cell_number, one_signal_a_cell


@pytest.fixture
def car(tmp_path):
    """A DBC and a candump log of 90 cells."""
    peer = one_signal_a_cell(90, 45, "Voltage_Cell_{:02d}", "Temp_Sensor_{:02d}", 0.0001, "V")
    return written(peer, tmp_path)


def written(peer, folder, seconds=6):
    (folder / "car.dbc").write_text(peer.dbc())
    lines = [f"({t / 1e9:.6f}) can0 {i:03X}#{data.hex().upper()}" for t, i, data in peer.frames(seconds)]
    (folder / "car.log").write_text("\n".join(lines) + "\n")
    return folder


def test_every_bundled_profile_is_listed_and_shown(capsys):
    assert main(["battery", "list"]) == 0
    listed = capsys.readouterr().out
    for name in bundled_profiles():
        assert name in listed
        if name != "ivt-s":
            assert main(["battery", "show", name]) == 0
            assert str(load_profile(name).profile.battery.n_cells) in capsys.readouterr().out


@pytest.mark.parametrize("name", ["foxbms-2", "one-signal-a-cell"])
def test_bundled_profiles_have_no_warnings(name, capsys):
    assert main(["battery", "check", name]) == 0, capsys.readouterr().out


def test_what_is_learned_can_be_checked_with_the_same_log(car, capsys):
    out = car / "profiles" / "car.toml"
    out.parent.mkdir()
    assert main(["battery", "learn", "--dbc", f"{car}/car.dbc", "--log", f"{car}/car.log", "--out", str(out)]) == 0
    told = capsys.readouterr().out
    assert "suggested: 90 cells" in told
    assert "45 temperature sensors" in told
    assert main(["battery", "check", str(out), "--log", f"{car}/car.log"]) == 0, capsys.readouterr().out
    assert main(["battery", "show", str(out)]) == 0
    assert "positive on discharge" in capsys.readouterr().out


def test_a_log_alone_is_read_by_the_definitions_that_come_along(tmp_path, capsys):
    written(cell_number(), tmp_path, 9)
    assert main(["battery", "learn", "--log", f"{tmp_path}/car.log"]) == 0
    told = capsys.readouterr().out
    assert "suggested: 72 cells" in told
    assert 'checksum = "orion"' in told


def test_a_bus_is_listened_to(tmp_path, capsys):
    peer = one_signal_a_cell(12, 0, "CellVoltage{}", "T{}", 0.0001, "V")
    (tmp_path / "car.dbc").write_text(peer.dbc())
    frames, stopping = peer.frames(1), threading.Event()

    def speak():
        with can.Bus("voltwall-learn", interface="virtual") as bus:
            while not stopping.is_set():
                for _, can_id, data in frames:
                    bus.send(can.Message(arbitration_id=can_id, is_extended_id=False, data=data))
                stopping.wait(0.05)

    car = threading.Thread(target=speak)
    car.start()
    try:
        command = ["battery", "learn", "--dbc", f"{tmp_path}/car.dbc", "--can", "virtual:voltwall-learn"]
        assert main([*command, "--seconds", "1.5"]) == 0
    finally:
        stopping.set()
        car.join()
    assert "12 of 12 cells received" in capsys.readouterr().out


def test_all_errors_are_told_at_once_each_with_file_line_and_field(car, capsys):
    wrong = car / "wrong.toml"
    wrong.write_text('[battery]\nname = "x"\npacks = [0]\n[source]\ndbc = "car.dbc"\n')
    assert main(["battery", "check", str(wrong)]) == 2
    assert "wrong.toml:3: error: battery.packs = 0: a whole number 1..1000" in capsys.readouterr().out
    wrong.write_text('[battery]\nname = "x"\nsegments = [1]\n[source]\ndbc = "no.dbc"\n')
    assert main(["battery", "check", str(wrong)]) == 2
    assert "no.dbc" in capsys.readouterr().out
    wrong.write_text(
        '[battery]\nname = "x"\nsegments = [1]\n[source]\ndbc = "car.dbc"\n[[source.voltage]]\nsignal = "Q{cell}"\n'
    )
    assert main(["battery", "check", str(wrong)]) == 2
    assert "wrong.toml:6: error: source.voltage[0].signal" in capsys.readouterr().out
    wrong.write_text(
        '[battery]\nname = "x"\nsegments = [1]\nparalel = 2\n[source]\ndbc = "car.dbc"\n'
        '[[source.voltage]]\nsignal = "Q{cell}"\nunit = "kV"\n[source.current]\npositive = "up"\n'
    )
    assert main(["battery", "check", str(wrong)]) == 2
    told = capsys.readouterr().out
    expected = [
        "4: error: battery.paralel",
        "7: error: source.voltage[0].signal",
        "9: error: source.voltage[0].unit",
        "10: error: source.current.signal: missing",
        "11: error: source.current.positive",
    ]
    assert [line for line in expected if f"wrong.toml:{line}" not in told] == []
    assert told.endswith("5 errors, 0 warnings\n")


def test_a_bus_of_something_else_is_told_and_ends_with_1(car, tmp_path, capsys):
    dbc = tmp_path / "motor.dbc"
    dbc.write_text('VERSION ""\nNS_ :\nBS_:\nBU_: MC\nBO_ 9 Motor: 8 MC\n SG_ Speed : 0|16@1+ (1,0) [0|0] "rpm" X\n')
    assert main(["battery", "learn", "--dbc", str(dbc)]) == 1
    assert "no cell voltages" in capsys.readouterr().out


def test_nothing_to_learn_from_is_an_error(capsys):
    assert main(["battery", "learn"]) == 2
    assert "--dbc" in capsys.readouterr().err


def test_a_withdrawn_table_is_an_error_of_its_line_among_the_others(tmp_path, capsys):
    profile = tmp_path / "mine.toml"
    witness = '[[witness]]\nname = "second"\ndbc = "ivt-s.dbc"\n'
    profile.write_text(f'include = ["foxbms-2"]\n{witness}[battery]\nparalel = 2\n')
    assert main(["battery", "check", str(profile)]) == 2
    found = capsys.readouterr().out
    assert "mine.toml:2: error: witness = [[witness]]: no longer supported" in found
    assert "mine.toml:6: error: battery.paralel" in found
    assert main(["battery", "show", str(profile)]) == 2
    assert "mine.toml:2: witness" in capsys.readouterr().err


def test_a_battery_is_sized_from_a_cell_file_and_a_layout(capsys):
    assert main(["battery", "size", "--cell", "samsung-25r-10p", "--segments", "8x12"]) == 0
    text = capsys.readouterr().out
    assert main(["battery", "size", "--segments", "8x12", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["layout"] == {"n_segments": 8, "n_in_series": 12, "n_parallel": 1}
    for figure in told["figures"].values():
        (line,) = [line for line in text.splitlines() if line.startswith(figure["title"])]
        assert f"{figure['battery']:.4g}" in line
        assert figure["unit"] in line
        assert figure["condition"] in line


def test_what_a_cell_file_does_not_say_is_told_not_guessed(capsys):
    words = ["battery", "size", "--cell", "panasonic-ncr18650pf", "--segments", "1x14", "--parallel", "9"]
    assert main(words) == 0
    text = capsys.readouterr().out
    for field in ("v_nominal_v", "mass_kg", "limits.discharge_max_a", "limits.charge_max_a"):
        assert f"not known: the cell file has no {field}" in text
    assert main([*words, "--json"]) == 0
    figure = json.loads(capsys.readouterr().out)["figures"]["discharge_power_10s_kw"]
    assert figure["battery"] is None
    assert figure["missing"] == ["limits.discharge_max_a"]


@pytest.mark.parametrize(
    ("words", "names"),
    [
        (["--segments", "8"], "8x12"),
        (["--segments", "0x12"], "8x12"),
        (["--segments", "8x12", "--parallel", "0"], "1 to 1000"),
        (["--segments", "8x12", "--soc", "101"], "0 to 100 percent"),
    ],
)
def test_a_layout_that_is_none_is_refused(words, names, capsys):
    with pytest.raises(SystemExit) as left:
        main(["battery", "size", *words])
    assert left.value.code == 2
    assert names in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "names"), [(["--temperature", "80"], "-20 to 75 degC"), (["--cell", "no-such-cell"], "Bundled cells")]
)
def test_a_cell_that_cannot_be_sized_is_refused_in_one_line(words, names, capsys):
    assert main(["battery", "size", "--segments", "8x12", *words]) == 2
    told = capsys.readouterr().err
    assert names in told
    assert told.count("\n") == 1
