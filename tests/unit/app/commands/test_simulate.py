import pytest

from app.cli import main
from tests.peer_messages import HEAD


@pytest.fixture
def profile(tmp_path):
    (tmp_path / "a.dbc").write_text(HEAD + 'BO_ 1 M: 8 B\n SG_ U1 : 0|16@1+ (1,0) [0|0] "mV" B\n')

    def write(signal: str, cells: int = 1) -> str:
        file = tmp_path / "a.toml"
        file.write_text(
            f'[battery]\nname = "a"\nsegments = [{cells}]\n[source]\ndbc = "a.dbc"\n'
            f'[[source.voltage]]\nsignal = "{signal}"\nbase = 1\n'
        )
        return str(file)

    return write


def test_a_battery_is_simulated_into_a_log(profile, tmp_path, capsys):
    log = tmp_path / "a.log"
    command = ["simulate", "--battery", profile("U{cell}"), "--can", f"log:{log}", "--speed", "max", "--duration", "2"]
    assert main(command) == 0
    assert 15 < len(log.read_text().splitlines()) <= 21
    assert "ready" in capsys.readouterr().out


def test_what_the_dbc_has_no_place_for_is_told(profile, tmp_path, capsys):
    words = ["--can", f"log:{tmp_path}/a.log", "--speed", "max", "--duration", "1"]
    main(["simulate", "--battery", profile("U{cell}", 3), *words])
    assert "2 values of voltage have no place in the DBC" in capsys.readouterr().err


def test_a_profile_that_fits_nothing_of_its_dbc_is_refused(profile, tmp_path, capsys):
    assert main(["simulate", "--battery", profile("Q{cell}"), "--can", f"log:{tmp_path}/a.log"]) == 2
    assert "nothing would be sent" in capsys.readouterr().err


@pytest.mark.parametrize("port", [["--serial", "tcp:0"], ["--eeprom", "e.bin"]])
def test_what_only_the_teams_master_has_is_refused(profile, port, capsys):
    assert main(["simulate", "--battery", profile("U{cell}"), *port]) == 2
    assert "CAN only" in capsys.readouterr().err
