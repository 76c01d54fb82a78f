import json
import os
import subprocess
import sys

import pytest

from app import cli
from app.cli import main


def test_ctrl_c_anywhere_is_one_line_and_130(monkeypatch, capsys):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(cli, "build_parser", interrupted)  # while a command is imported, too
    assert main(["sessions", "list"]) == 130
    assert capsys.readouterr().err == "voltwall sessions: interrupted\n"
    assert main([]) == 130
    assert capsys.readouterr().err == "voltwall: interrupted\n"


@pytest.mark.parametrize("words", [["serve"], ["--help"], []])
def test_a_system_of_32_bits_is_refused_in_one_line(words):
    program = "import sys; sys.maxsize = 2**31 - 1\nimport app.cli\nsys.exit(app.cli.main(sys.argv[1:]))"
    done = subprocess.run([sys.executable, "-c", program, *words], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "voltwall: needs a 64-bit system with a 64-bit Python, and this one is of 32 bits\n"


@pytest.mark.parametrize("place", [0, 1, 3])
def test_no_color_is_told_to_what_colours(place, monkeypatch, capsys):
    monkeypatch.setattr(os, "environ", dict(os.environ))
    words = ["battery", "list", "--json"]
    assert main([*words[:place], "--no-color", *words[place:]]) == 0
    assert os.environ["NO_COLOR"] == "1"
    assert {"profile", "name", "cells", "segments", "sensors"} <= json.loads(capsys.readouterr().out)[0].keys()


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish", "powershell"])
def test_every_shell_is_told_how_to_complete(shell, capsys):
    assert main(["completion", shell]) == 0
    assert "voltwall" in capsys.readouterr().out


HEAVY = (
    *("numpy", "scipy", "pyarrow", "duckdb", "can", "serial", "asyncio"),
    *("fastapi", "uvicorn", "pydantic", "argon2", "matplotlib"),
)


@pytest.mark.parametrize("command", [None, *cli.COMMANDS])
def test_help_waits_for_nothing_that_only_the_work_needs(command):
    words = [*([command] if command else []), "--help"]
    program = "import sys, app.cli\ntry: app.cli.main(sys.argv[1:])\nfinally: print(*sys.modules, file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", program, *words], capture_output=True, text=True, check=True)
    allowed = {"pydantic", "asyncio"} if command == "serve" else set()  # its flags are the fields of the settings
    assert {*HEAVY} & {*done.stderr.split()} - allowed == set()
    assert done.stdout.startswith("usage: voltwall")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("accounts list --data FILE", "FILE: File exists"),
        ("season simulate --sessions 1 --data FILE", "FILE/sessions: Not a directory"),
        ("evidence --session missing --data FILE", "no session 'missing'"),
        ("firmware --cell missing", "cell = missing: cannot be read (No such file or directory). Bundled cells: "),
        ("firmware --cell FOLDER", "cell = FOLDER: cannot be read (Is a directory). Bundled cells: "),
        ("estimate FILE --cell missing", "missing: cannot be read (No such file or directory). Bundled cells: "),
        ("estimate missing --cell samsung-25r-10p", "missing: cannot be read: No such file or directory"),
        ("sessions import FILE", "FILE: the file is empty"),
        ("sessions check FILE", "FILE: empty"),
        ("dbc --out FOLDER", "out = FOLDER: Is a directory"),
        ("battery show missing", "battery = missing: unknown; available: "),
        ("serve --port 99999", "port = 99999: must be at most 65535"),
        ("battery show foxbms2", "battery = foxbms2: unknown, did you mean foxbms-2?"),
        ("sessions list --data FOLDR", "--data = FOLDR: no such folder, did you mean FOLDER?"),
        ("simulate --scenario race-dya", "race-dya: unknown scenario, did you mean 'race-day'?"),
    ],
)
@pytest.mark.skipif(os.name != "posix", reason="the words of this system's errors")
def test_a_mistake_is_one_line_that_names_it_once(words, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "FILE").touch()
    (tmp_path / "FOLDER").mkdir()
    command = words.split()[0]
    assert main(words.split()) == 2
    shown = capsys.readouterr().err
    assert shown.startswith(f"voltwall {command}: {said}")
    assert shown.count("\n") == 1
    assert all(shown.count(name) <= 1 for name in ("missing", "FOLDER"))


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        ("serv", "'serv', did you mean 'serve'?"),
        ("sessions lst", "'lst', did you mean 'list'?"),
        ("serve --prot 8001", "--prot 8001, did you mean '--port'?"),
        ("export x --format cvs --out -", "'cvs', did you mean 'csv'?"),
        ("xyzzy", "'xyzzy'. Use one of serve, "),
    ],
)
def test_a_word_that_is_unknown_gets_the_one_that_was_meant(words, meant, capsys):
    with pytest.raises(SystemExit, match="2"):
        main(words.split())
    assert f"unknown {meant}" in capsys.readouterr().err


@pytest.mark.parametrize("command", sorted(cli.COMMANDS))
def test_a_help_says_what_the_command_is_for_and_ends_with_examples(command):
    parser = cli.build_parser(command)._subparsers._group_actions[0].choices[command]
    assert parser.description[0].isupper()
    assert f"voltwall {command}" in parser.epilog.rpartition("examples:")[2]
