"""`voltwall replay --assert` on a session of the simulated car, and its exit codes."""

import io
import json
from pathlib import Path

import pytest

from app.cli import main
from app.sessions.reading.reader import SessionFile
from tests.recorded.scenario import ScenarioRecorder

SECONDS = 8.0


@pytest.fixture(scope="module")
def session(tmp_path_factory) -> Path:
    made = ScenarioRecorder(tmp_path_factory.mktemp("sessions"), "clean-endurance")
    made.run(SECONDS)
    made.close()
    return made.info.path


def prove(session: Path, tmp_path: Path, text: str, *more: str) -> int:
    (tmp_path / "expected.toml").write_text(text)
    return main(["replay", str(session), "--assert", str(tmp_path / "expected.toml"), *more])


def test_a_replay_with_the_same_filter_gives_the_recorded_estimates_again(session, tmp_path, capsys):
    text = '[[agreement]]\nlargest_max = 0.00002\n[[no_alarm]]\nseverity = "trip"\n'  # half a count of what is stored
    assert prove(session, tmp_path, text) == 0
    assert "2 of 2 held" in capsys.readouterr().out


def test_a_session_is_proved_with_the_cell_file_that_it_keeps_and_that_is_told(session, tmp_path, capsys):
    text = "[[agreement]]\nlargest_max = 0.00002\n"
    assert prove(session, tmp_path, text, "--json") == 0
    told = json.loads(capsys.readouterr().out)["judged"]
    assert any("evaluated with the cell model recorded in the session" in each.lower() for each in told)
    assert prove(session, tmp_path, text, "--cell", "sanyo-ur18650w") == 1
    assert "sanyo-ur18650w" in capsys.readouterr().out


def test_what_does_not_hold_is_told_with_what_was_found(session, tmp_path, capsys):
    with SessionFile(session) as file:
        last_s = file.info.duration_s - 2
    text = f'[[value]]\nname = "soc"\nat_s = {last_s}\nmax = 0.5\n[[alarm]]\ncode = "cell-overtemperature"\n'
    assert prove(session, tmp_path, text, "--json") == 1
    verdicts = json.loads(capsys.readouterr().out)
    assert verdicts["held"] is False
    assert [each["held"] for each in verdicts["expectations"]] == [False, False]
    assert 0.9 < float(verdicts["expectations"][1]["found"]) < 0.96


def test_another_filter_is_compared_with_what_was_recorded(session, tmp_path, capsys):
    assert prove(session, tmp_path, "[[agreement]]\nlargest_max = 0.00002", "--filter", "coulomb") == 1
    assert prove(session, tmp_path, "[[agreement]]\nlargest_max = 0.05", "--filter", "coulomb") == 0


@pytest.mark.parametrize("text", ["[[", '[[alarm]]\ncell = "1/1"', '[replay]\nfilter = "x"\n[[alarm]]\ncode = "y"'])
def test_what_cannot_be_checked_has_a_code_of_its_own(session, tmp_path, text):
    assert prove(session, tmp_path, text) == 2
    assert main(["replay", str(session), "--assert", str(tmp_path / "missing.toml")]) == 2


def test_on_a_terminal_it_shows_how_far_it_is(session, tmp_path, capsys, monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    shown = Terminal()
    monkeypatch.setattr("sys.stderr", shown)
    monkeypatch.setattr("app.commands.console.SHOWN_AFTER_S", 0.0)
    monkeypatch.setattr("app.commands.console.EVERY_S", 0.0)
    assert prove(session, tmp_path, "[[agreement]]\nlargest_max = 0.00002") == 0
    lines = [line.split() for line in shown.getvalue().split("\r") if "%" in line]
    assert len(lines) > 10
    shares = [float(words[1]) for words in lines]
    assert shares == sorted(shares)
    assert shares[-1] > 95.0
    assert {words[-1] for words in lines} == {"left"}
    assert shown.getvalue().endswith("\r")
