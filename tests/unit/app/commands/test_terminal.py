"""Tables at the width of a terminal, colours where they are wanted: on a real pseudo-terminal where one is meant."""

import os
import sys

import pytest

from app.commands.console import RED, coloured, print_table, printable

pty, termios = pytest.importorskip("pty"), pytest.importorskip("termios")
HEADS = ("id", "frames", "name")
ROWS = [("20260714-103000", "12345", "FSG endurance, second driver"), ("20260714-1", "7", "Łukasz")]


@pytest.fixture
def terminal(monkeypatch):
    """Let standard output be a terminal of a width; return what reads from it."""
    ours, theirs = pty.openpty()
    stream = os.fdopen(theirs, "w", encoding="utf-8")

    def of(columns, **environment):
        termios.tcsetwinsize(theirs, (24, columns))
        monkeypatch.setattr(sys, "stdout", stream)
        monkeypatch.setattr(sys, "__stdout__", stream)
        for name in ("COLUMNS", "NO_COLOR"):
            monkeypatch.delenv(name, raising=False)
        monkeypatch.setenv("TERM", "xterm")
        for name, value in environment.items():
            monkeypatch.setenv(name, value)

        def read():
            stream.write("\0")
            stream.flush()
            got = b""
            while not got.endswith(b"\0"):
                got += os.read(ours, 65536)
            return got[:-1].decode().replace("\r\n", "\n")

        return read

    yield of
    stream.close()
    os.close(ours)


@pytest.mark.parametrize("columns", [20, 33, 40, 52, 200])
def test_no_line_is_wider_than_the_terminal_and_numbers_stay_whole(columns, terminal):
    read = terminal(columns, NO_COLOR="1")
    print_table(HEADS, ROWS, "<><")
    lines = read().splitlines()
    assert len(lines) == 3
    assert max(map(len, lines)) <= columns
    assert all(number in line for number, line in zip(("frames", "12345", "     7"), lines, strict=True))
    assert ("…" in "".join(lines)) == (columns < 54)
    assert ("FSG endurance, second driver" in lines[1]) == (columns >= 54)


def test_where_nobody_looks_nothing_is_shortened_or_coloured(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "20")
    print_table(HEADS, ROWS, "<><")
    print(coloured("wrong", RED))
    assert capsys.readouterr().out.splitlines() == [
        "id               frames  name",
        "20260714-103000   12345  FSG endurance, second driver",
        "20260714-1            7  Łukasz",
        "wrong",
    ]


def test_a_terminal_gets_its_heads_bold_and_a_warning_red(terminal):
    read = terminal(80)
    print_table(HEADS, ROWS, "<><")
    print(coloured("wrong", RED))
    lines = read().splitlines()
    assert lines[0].startswith("\x1b[1mid ")
    assert lines[-1] == "\x1b[31mwrong\x1b[0m"
    assert "\x1b" not in lines[1]


@pytest.mark.parametrize("environment", [{"NO_COLOR": "1"}, {"TERM": "dumb"}])
def test_who_wants_no_colours_gets_none(environment, terminal):
    read = terminal(80, **environment)
    print(coloured("wrong", RED))
    assert read() == "wrong\n"


def test_an_empty_table_is_its_heads(capsys):
    print_table(HEADS, [])
    print_table((), [])
    assert capsys.readouterr().out == "id  frames  name\n"


def test_a_name_in_a_foreign_file_cannot_command_the_terminal(capsys):
    name = "run\x1b]0;owned\x07\x9b2J\u202e\nnext"
    print_table(("id", "name"), [("1", name)])
    head, row, *rest = capsys.readouterr().out.split("\n")
    assert (head, rest) == ("id  name", [""])
    assert row == "1   run\ufffd]0;owned\ufffd\ufffd2J\ufffd next"


def test_every_script_and_sign_is_printed_as_it_is():
    text = "Łukasz\tÅse 电池 سيارة 🏎️ 1.2 mΩ\n±0.1"
    assert printable(text) == text
