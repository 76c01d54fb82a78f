"""What the service words itself has a Norwegian text: fixed texts whole, sentences with values by pattern."""

import ast
import json
import re
from pathlib import Path

import pytest

from app.sources.master.decode import CHARGER_FLAGS
from app.sources.master.events import describe
from firmware_protocol.memory_map import CONFIG
from firmware_protocol.messages import EventCode, EventMessage
from simulator.faults import FAULTS
from simulator.library import library
from simulator.scenario_file import load_scenario
from simulator.scenario_player import ScenarioPlayer

ROOT = Path(__file__).resolve().parents[2]
NORWEGIAN = json.loads((ROOT / "frontend/src/words/nb/service.json").read_text())
TEXTS, PATTERNS = NORWEGIAN["texts"], [re.compile(pattern) for pattern, _ in NORWEGIAN["patterns"]]


def is_known(sentence: str) -> bool:
    sentence = " ".join(sentence.split())
    return sentence in TEXTS or any(pattern.fullmatch(sentence) for pattern in PATTERNS)


def test_every_scenario_fault_and_parameter_is_explained_in_norwegian():
    scenarios = [text for each in library()[0] for text in (each.title, each.description)]
    faults = [text for each in FAULTS.values() for text in (each.meaning, each.area)]
    parameters = [text for each in CONFIG.values() for text in (each.meaning, each.group)]
    assert [text for text in (*scenarios, *faults, *parameters, *CHARGER_FLAGS) if text and not is_known(text)] == []


@pytest.mark.parametrize("code", EventCode)
def test_every_event_of_the_master_is_told_in_norwegian(code):
    event, _ = describe(EventMessage(code, 30, 1, 2, 0), 0)
    assert is_known(event.text), event.text


@pytest.mark.parametrize(
    ("load", "at_s", "action"), [("idle", 4, "charge-start"), ("rest", 2, "store"), ("rest", 9, "reset")]
)
def test_what_a_scenario_could_not_do_is_told_in_norwegian(tmp_path, load, at_s, action):
    path = tmp_path / "any.toml"
    path.write_text(
        f'title = "t"\ndescription = "d"\n[[phase]]\nload = "{load}"\nfor_s = 5\n'
        '[[fault]]\nat_s = 1\nname = "brown-out"\nvalue = 2\n'
        f'[[action]]\nat_s = {at_s}\nname = "{action}"\n'
    )
    player = ScenarioPlayer(load_scenario(path), step_s=0.1)
    player.run(6.0)
    assert [is_known(notice.text) for notice in player.notices] == [True]


def test_the_words_of_the_sources_are_known():
    """Every text literal that a condition of the watch is raised with, its values as 7."""
    source = (ROOT / "app/live/conditions.py").read_text()
    found = re.findall(r'Condition\(\s*f?"[^"]*", "\w+", (f?)"([^"]*)"', source)
    assert len(found) > 10
    sentences = [re.sub(r"\{[^}]*\}", "7", text) if is_f else text for is_f, text in found]
    assert [text for text in sentences if not is_known(text) and not text.startswith("7 ")] == []


def test_every_title_of_a_problem_is_told_in_norwegian():
    titles = set()
    for path in (ROOT / "app").rglob("*.py"):
        for call in (node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call)):
            if getattr(call.func, "id", "") == "Problem" and isinstance(call.args[2], ast.Constant):
                titles.add(call.args[2].value)
    assert len(titles) > 20
    assert sorted(title for title in titles if not is_known(title)) == []
