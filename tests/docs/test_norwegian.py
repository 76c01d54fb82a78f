"""What the service words itself has a Norwegian text: fixed texts whole, sentences with values by pattern."""

import json
import re
from pathlib import Path

import pytest

from app.decode import CHARGER_FLAGS
from app.master_events import describe
from firmware_protocol.memory_map import CONFIG
from firmware_protocol.messages import Event, EventCode
from simulator.faults import FAULTS
from simulator.library import library

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
    event, _ = describe(Event(code, 30, 1, 2, 0), 0)
    assert is_known(event.text), event.text


def test_the_words_of_the_sources_are_known():
    """Every text literal that a condition of the watch is raised with, its values as 7."""
    source = (ROOT / "app/watch/conditions.py").read_text()
    found = re.findall(r'Condition\(\s*f?"[^"]*", "\w+", (f?)"([^"]*)"', source)
    assert len(found) > 10
    sentences = [re.sub(r"\{[^}]*\}", "7", text) if is_f else text for is_f, text in found]
    assert [text for text in sentences if not is_known(text) and not text.startswith("7 ")] == []
