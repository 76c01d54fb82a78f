"""The tables of words against the code: every code that a program tells has words in every language, and no others."""

import ast
import json
import re
from functools import cache
from pathlib import Path

import pytest

from app.api.web.problems import HTTP_SLUGS
from app.sessions.export.formats import FORMATS
from app.sources.master.decode import CHARGER_FLAGS
from app.words.conditions import CONDITIONS
from app.words.render import languages, table
from firmware_protocol.memory_map import CONFIG
from simulator.fault_kinds import FAULTS
from simulator.library import library
from simulator.scenario_player import NOTICES

ROOT = Path(__file__).resolve().parents[2]
APP = ROOT / "app"
OTHERS = [language for language in languages() if language != "en"]


def calls(name):
    """Every call of `name` in app, with its file."""
    for path in APP.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)) if f"{name}(" in text else ():
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == name:
                yield path.relative_to(ROOT).as_posix(), node


@cache
def used():
    """Return code -> names of the arguments that it is given, of every message in the code."""
    found = {}
    for path, call in calls("Message"):
        if path == "app/words/message.py":
            continue  # takes messages back from JSON
        place = f"{path}:{call.lineno}"
        assert isinstance(call.args[0], ast.Constant), f"{place}: the code of a message is written out"
        names = {keyword.arg for keyword in call.keywords}
        assert None not in names, f"{place}: the arguments of a message are written out"
        code = call.args[0].value
        assert found.setdefault(code, names) == names, f"{place}: {code} has other arguments elsewhere"
    slugs = {call.args[1].value for _, call in calls("Problem") if isinstance(call.args[1], ast.Constant)}
    found |= {code: placeholders(text) for code, text in NOTICES.items()}
    found |= {code: placeholders(table("en")[code]) for code in CONDITIONS if code not in found}
    return found | {f"problem-{slug}": set() for slug in {*slugs, *HTTP_SLUGS.values(), "http"}}


def placeholders(template):
    texts = [template] if isinstance(template, str) else [*template.values(), "{n}"]
    return {name for text in texts for name in re.findall(r"\{(\w+)\}", text)}


def keys(language, name):
    """Return the keys of a table of a language."""
    return set(json.loads((APP / "words" / language / f"{name}.json").read_text(encoding="utf-8")))


@pytest.mark.parametrize("language", languages())
def test_every_message_has_words_with_exactly_its_arguments(language):
    words = table(language)
    assert sorted(set(used()) - set(words)) == []
    wrong = {code: names for code, names in used().items() if placeholders(words[code]) != names}
    assert wrong == {}


def sentences(path):
    """Lines of a module that add a bare text to `notes`."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if (
            isinstance(node, ast.Call)
            and isinstance(node.func, ast.Attribute)
            and node.func.attr in ("append", "extend")
        ):
            target, added = node.func.value, node.args
        elif isinstance(node, ast.AugAssign):
            target, added = node.target, [node.value]
        else:
            continue
        told = [part for each in added for part in (each.elts if isinstance(each, ast.List) else [each])]
        told = [part.elt if isinstance(part, ast.ListComp) else part for part in told]
        if getattr(target, "id", "") == "notes" and any(
            isinstance(each, ast.Constant | ast.JoinedStr) for each in told
        ):
            yield node.lineno


@pytest.mark.parametrize("folder", ["sources/recordings", "sessions/transfer"])
def test_what_an_import_notes_has_a_code(folder):
    assert [f"{path.name}:{line}" for path in sorted((APP / folder).glob("*.py")) for line in sentences(path)] == []


@pytest.mark.parametrize("language", languages())
def test_no_words_are_left_that_nothing_tells(language):
    assert sorted(set(table(language)) - set(used())) == []


@pytest.mark.parametrize("language", OTHERS)
def test_a_language_has_the_keys_of_the_first(language):
    assert keys(language, "codes") == keys("en", "codes")
    assert keys(language, "page") == keys("en", "page")


@pytest.mark.parametrize("language", OTHERS)
def test_every_parameter_scenario_fault_flag_and_format_has_a_name(language):
    wanted = {f"parameter.{name}" for name in CONFIG} | {f"group.{field.group}" for field in CONFIG.values()}
    wanted |= {f"fault.{name}" for name in FAULTS} | {f"area.{kind.area}" for kind in FAULTS.values()}
    wanted |= {f"scenario.{each.name}.{part}" for each in library()[0] for part in ("title", "description")}
    wanted |= {f"flag.{flag}" for flag in CHARGER_FLAGS}
    wanted |= {f"format.{name}" for name, each in FORMATS.items() if not each.is_part}
    assert keys(language, "names") == wanted
