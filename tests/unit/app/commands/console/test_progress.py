import io
from pathlib import Path

import pytest

from app.cli import main
from app.commands.console import progress
from app.commands.console.progress import Progress, time_left


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def now(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    clock = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: clock[0])
    return clock


def test_the_time_left_is_shown_after_a_moment(now: list[float], monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    line = Progress("run.log")
    line(1, 10)
    assert terminal.getvalue() == ""
    now[0] += 5.0
    line(2, 10)
    assert terminal.getvalue().rstrip() == "\rrun.log  20.0 %, 20 s left"
    line.end()
    assert terminal.getvalue().endswith("\r")


def test_nothing_is_shown_where_there_is_no_terminal(now: list[float], monkeypatch: pytest.MonkeyPatch) -> None:
    told = io.StringIO()
    monkeypatch.setattr("sys.stderr", told)
    line = Progress()
    now[0] += 5.0
    line(2, 10)
    line.end()
    assert told.getvalue() == ""


@pytest.mark.parametrize(("seconds", "text"), [(8.2, "8 s"), (180.0, "3 min"), (7500.0, "2 h 5 min")])
def test_a_time_is_told_as_people_do(seconds: float, text: str) -> None:
    assert time_left(seconds) == text


def test_what_an_interrupted_job_says_stands_in_a_line_of_its_own(
    now: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(_: object) -> int:
        line = Progress("run.log")
        now[0] += 5.0
        line(2, 10)
        raise KeyboardInterrupt

    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    monkeypatch.setattr("app.commands.dbc.run", interrupted)
    assert main(["dbc"]) == 130
    shown = terminal.getvalue().removesuffix("\n").rpartition("\r")
    assert "run.log" in shown[0]
    assert shown[2] == "voltwall dbc: interrupted"


def test_an_error_of_an_identification_halfway_stands_in_a_line_of_its_own(
    now: list[float], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def fails(*arguments: object) -> None:
        on_progress = arguments[-1]
        assert isinstance(on_progress, Progress)
        now[0] += 5.0
        on_progress(2, 10)
        raise OSError("no space")

    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    monkeypatch.setattr("app.commands.cell_commands.identify.read_recording", lambda *_: None)
    monkeypatch.setattr("app.commands.cell_commands.identify.identify", fails)
    words = ["identify", "--ocv", "slow.csv", "--pulses", "pulses.csv", "--out", str(tmp_path / "mine.json")]
    assert main(words) == 2
    shown = terminal.getvalue().removesuffix("\n").rpartition("\r")
    assert "mine  20.0 %" in shown[0]
    assert shown[2] == "voltwall identify: no space"


def test_an_error_of_the_filter_halfway_stands_in_a_line_of_its_own(
    now: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    class Cell:
        capacity_ah = 2.5

    class Read:
        source = "run"

    def fails(*arguments: object) -> None:
        on_progress = arguments[-1]
        assert isinstance(on_progress, Progress)
        now[0] += 5.0
        on_progress(2, 10)
        raise OSError("no space")

    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    monkeypatch.setattr("app.commands.cell_commands.estimate.check_outputs", lambda *_: None)
    monkeypatch.setattr("app.commands.cell_commands.estimate.load_cell", lambda *_: Cell())
    monkeypatch.setattr("app.commands.cell_commands.estimate.make_estimator", lambda *_: None)
    monkeypatch.setattr("app.commands.cell_commands.estimate.read_recording", lambda *_: None)
    monkeypatch.setattr("app.commands.cell_commands.estimate.believable", lambda *_: Read())
    monkeypatch.setattr("app.commands.cell_commands.estimate.run_filter", fails)
    assert main(["estimate", "run.csv", "--cell", "mine"]) == 2
    shown = terminal.getvalue().removesuffix("\n").rpartition("\r")
    assert "run  20.0 %" in shown[0]
    assert shown[2] == "voltwall estimate: no space"
