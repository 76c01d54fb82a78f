"""The generated reference is current and complete."""

import importlib
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest

from app.cli import COMMANDS
from app.service.settings import Settings

ROOT = Path(__file__).resolve().parents[2]
REFERENCE = ROOT / "docs" / "reference"


@pytest.fixture
def generated(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(ROOT / ".ci"))
    module = importlib.import_module("generated")
    yield module
    sys.modules.pop("generated")


def test_every_generated_file_is_current(generated: ModuleType) -> None:
    assert generated.stale_files() == []


def test_a_changed_file_is_noticed(
    generated: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    name = "docs/reference/settings.md"
    monkeypatch.setattr(generated, "GENERATED", {name: lambda: "something else\n"})
    assert generated.main(["--check"]) == 1
    assert name in capsys.readouterr().out


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_its_section(command: str) -> None:
    assert f"\n## voltwall {command}\n" in (REFERENCE / "cli.md").read_text(encoding="utf-8")


def test_every_flag_of_every_command_says_what_it_means() -> None:
    rows = re.findall(r"^\| `([^`]+)` \|(.*)\|$", (REFERENCE / "cli.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert len(rows) > 30
    assert [flag for flag, meaning in rows if not meaning.strip()] == []


@pytest.mark.parametrize("name", Settings.model_fields)
def test_every_setting_is_documented_with_its_variable(name: str) -> None:
    row = next(
        line
        for line in (REFERENCE / "settings.md").read_text(encoding="utf-8").splitlines()
        if f"`VOLTWALL_{name.upper()}`" in line
    )
    assert Settings.model_fields[name].description in row


def test_every_alarm_stands_in_its_table_with_its_severity() -> None:
    source = (ROOT / "app" / "live" / "alarm_rules.py").read_text(encoding="utf-8")
    raised = re.findall(r'Condition\(\s*"(\w+)",\s*Message\("([\w-]+)"', source)
    assert len(raised) > 10
    tables = re.split(r"^## ", (REFERENCE / "alarms.md").read_text(encoding="utf-8"), flags=re.MULTILINE)
    listed = {
        (title.lower(), code)
        for title, body in (t.split("\n", 1) for t in tables[1:])
        for code in re.findall(r"`([\w-]+)`", body)
    }
    assert [each for each in raised if each not in listed] == []
