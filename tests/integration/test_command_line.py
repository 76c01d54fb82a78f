"""The command line as a program of its own: Ctrl-C, code pages, shells that complete it."""

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROGRAM = [sys.executable, "-m", "app.cli"]


def start(*words: str, **more: object) -> subprocess.Popen[str]:
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell that runs the tests in the background ignores it
    return subprocess.Popen([*PROGRAM, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **more)


def interrupted(process: subprocess.Popen[str]) -> tuple[int, str]:
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    return process.returncode, said


@pytest.mark.skipif(os.name != "posix", reason="sends the signal of a terminal")
def test_ctrl_c_while_it_computes_is_one_line_and_130():
    process = start("balance")
    assert process.stdout is not None
    assert process.stdout.readline().startswith("96 cells")
    assert interrupted(process) == (130, "voltwall balance: interrupted\n")


@pytest.mark.skipif(os.name != "posix", reason="sends the signal of a terminal")
@pytest.mark.parametrize("words", [("sessions", "fetch"), ("config", "history", "--url")], ids=lambda words: words[0])
def test_ctrl_c_while_it_waits_for_an_answer_is_one_line_and_130(words, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as silent:
        process = start(
            *words,
            f"http://127.0.0.1:{silent.getsockname()[1]}",
            env=os.environ | {"VOLTWALL_DATA": str(tmp_path), "NO_PROXY": "*", "no_proxy": "*"},
        )
        asked, _ = silent.accept()
        with asked:
            assert asked.recv(1)
            assert interrupted(process) == (130, f"voltwall {words[0]}: interrupted\n")


@pytest.mark.parametrize("code_page", ["cp1252", "cp437", "ascii", "utf-8"])
def test_a_name_of_any_letters_is_printed_on_any_code_page(code_page, tmp_path):
    run = {"env": os.environ | {"PYTHONIOENCODING": code_page, "PYTHONUTF8": "0"}, "capture_output": True}
    refused = subprocess.run(
        [*PROGRAM, "export", "Łukasz", "--out", "a.csv", "--data", str(tmp_path)], **run, check=False
    )
    assert refused.returncode == 2
    assert "Łukasz".encode(code_page, "replace") in refused.stderr
    assert refused.stderr.count(b"\n") == 1


@pytest.fixture
def on_path(tmp_path: Path) -> dict[str, str]:
    """An environment in which `voltwall` is a program, and which a shell starts with."""
    program = tmp_path / "bin" / "voltwall"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nPYTHONPATH="{ROOT}" exec "{sys.executable}" -m app.cli "$@"\n')
    program.chmod(0o755)
    return os.environ | {"PATH": f"{program.parent}:{os.environ['PATH']}", "HOME": str(tmp_path)}


LINES = {  # what a person has typed, and what Tab offers
    "voltwall se": {"serve", "sessions", "season"},
    "voltwall season b": {"build"},
    "voltwall serve --mqtt-": {"--mqtt-ca"},
    "voltwall export x --format m": {"mcap", "mf4", "motec"},
}
BASH = """
eval "$(voltwall completion bash)"
function=$(complete -p voltwall | sed 's/.*-F \\([^ ]*\\).*/\\1/')
while read -r line; do
  COMP_LINE=$line COMP_POINT=${#line} COMP_TYPE=9 COMP_WORDS=($line) COMP_CWORD=$((${#COMP_WORDS[@]} - 1)) COMPREPLY=()
  $function voltwall
  echo ${COMPREPLY[@]}
done
"""
FISH = """
voltwall completion fish | source
while read line
  complete -C "$line" | string split -f1 \\t | string join " "
end
"""


@pytest.mark.parametrize(("shell", "code"), [("bash", BASH), ("fish", FISH)])
def test_a_real_shell_completes_commands_actions_options_and_values(shell, code, on_path):
    if shutil.which(shell) is None:
        pytest.skip(f"no {shell} here")
    typed = "".join(f"{line}\n" for line in LINES)
    done = subprocess.run([shell, "-c", code], input=typed, env=on_path, capture_output=True, text=True, check=True)
    assert [{*line.split()} for line in done.stdout.splitlines()] == list(LINES.values()), done.stderr


def test_lists_are_arrays_of_objects(voltwall, tmp_path):
    (tmp_path / "bad.toml").write_text('[battery]\nname = "x"\npacks = [0]\n')
    for words in (
        ("sessions", "list"),
        ("sessions", "check"),
        ("sessions", "missing"),
        ("battery", "list"),
        ("battery", "check", str(tmp_path / "bad.toml")),
        ("season", "query"),
        ("simulate", "--list"),
    ):
        done = voltwall(*words, "--json", VOLTWALL_DATA=str(tmp_path))
        entries = json.loads(done.stdout)
        assert isinstance(entries, list), words
        assert all(isinstance(entry, dict) for entry in entries)
        assert done.stdout.isascii()
    checked = json.loads(voltwall("battery", "check", str(tmp_path / "bad.toml"), "--json").stdout)
    assert {"kind": "error", "line": 3, "field": "battery.packs"}.items() <= checked[-1].items()
