import io

import pytest

from app.cli import main
from app.commands import console
from app.commands.console import Progress, time_left
from app.errors import AppError


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def now(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    clock = [100.0]
    monkeypatch.setattr(console.time, "monotonic", lambda: clock[0])
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


@pytest.mark.parametrize(
    ("ending", "exit_code", "text"),
    [(KeyboardInterrupt(), 130, "interrupted"), (OSError("no space"), 2, "no space"), (AppError("gone"), 2, "gone")],
)
def test_what_a_job_that_ends_halfway_says_stands_in_a_line_of_its_own(
    now: list[float], monkeypatch: pytest.MonkeyPatch, ending: BaseException, exit_code: int, text: str
) -> None:
    def ended(_: object) -> int:
        with Progress("run.log") as line:
            now[0] += 5.0
            line(2, 10)
            raise ending

    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    monkeypatch.setattr("app.commands.dbc.run", ended)
    monkeypatch.setenv("NO_COLOR", "1")
    assert main(["dbc"]) == exit_code
    shown = terminal.getvalue().removesuffix("\n").rpartition("\r")
    assert "run.log" in shown[0]
    assert shown[2] == f"voltwall dbc: {text}"
