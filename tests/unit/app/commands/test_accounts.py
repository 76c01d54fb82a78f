"""`voltwall accounts log`: what is in the signed log, and whether somebody changed it."""

import json

import pytest

from app.cli import main
from app.configuration.history import ConfigHistory


@pytest.fixture
def folder(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("VOLTWALL_ACCOUNT_PASSWORD", "pit lane at noon")
    assert main(["accounts", "add", "ada", "--role", "chief", "--data", str(tmp_path)]) == 0
    ConfigHistory(tmp_path).append(10**18, "ada", "command", "charge-start", "", b"", b"", "done")
    capsys.readouterr()
    return tmp_path


def test_every_change_is_a_line_with_its_outcome(folder, capsys):
    assert main(["accounts", "log", "--data", str(folder)]) == 0
    told = capsys.readouterr()
    first, second = told.out.splitlines()
    assert "command line: access account ada: chief, new password: done" in first
    assert "2001-09-09 01:46:40 ada: command charge-start: done" in second
    assert "all signatures right" in told.err
    assert main(["accounts", "log", "--data", str(folder), "--json"]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[1])["source"] == "charge-start"


def test_a_changed_log_is_told_by_the_exit_code(folder, capsys):
    path = folder / "config-history.jsonl"
    path.write_text(path.read_text().replace("charge-start", "charge-stop"))
    assert main(["accounts", "log", "--data", str(folder)]) == 1
    assert "NOT GENUINE" in capsys.readouterr().out


def test_a_folder_without_a_log_is_one_line(tmp_path, capsys):
    assert main(["accounts", "log", "--data", str(tmp_path)]) == 2
    assert "no signed log" in capsys.readouterr().err
