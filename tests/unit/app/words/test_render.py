import json
import math
from pathlib import Path

import pytest

from app.words import render as package
from app.words.message import Message, Quantity, message_from_json
from app.words.render import languages, number, render, table

VECTORS = json.loads((Path(__file__).parents[3] / "vectors/words.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("case", VECTORS["cases"], ids=lambda case: case["en"])
@pytest.mark.parametrize("language", ["en", "nb"])
def test_the_shared_vectors_hold(monkeypatch, case, language):
    monkeypatch.setitem(package.__globals__, "table", VECTORS["tables"].__getitem__)
    assert render(message_from_json(case["message"]), language) == case[language]


def test_english_and_norwegian_are_there():
    assert languages() == ["en", "nb"]


def test_a_language_without_a_folder_is_refused():
    with pytest.raises(FileNotFoundError):
        table("tlh")


@pytest.mark.parametrize("value", [None, math.nan, math.inf])
def test_a_missing_number_is_a_dash(value):
    assert number(value) == "–"
    assert number(value, 2) == "–"


def test_a_quantity_in_a_message_keeps_its_unit():
    message = Message("cell", pack=Quantity(1.5, "mohm"), cell=2)
    assert render(message) == "pack 1.5 mΩ, cell 2"
