import json
import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.battery.battery import Battery
from app.words import render as package
from app.words.message import Cell, Message, Quantity, coded, message_from_json
from app.words.render import languages, number, place_of, render, rendered, sentence, table

VECTORS = json.loads((Path(__file__).parents[3] / "vectors/words.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("case", VECTORS["cases"], ids=lambda case: case["en"])
@pytest.mark.parametrize("language", ["en", "nb"])
def test_the_shared_vectors_hold(monkeypatch, case, language):
    monkeypatch.setitem(package.__globals__, "table", VECTORS["tables"].__getitem__)
    assert render(message_from_json(case["message"]), VECTORS["segments"], language=language) == case[language]


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


@given(st.lists(st.integers(1, 30), min_size=1, max_size=20), st.data())
def test_a_cell_is_named_by_the_battery_of_whoever_renders(segments, data):
    cell = data.draw(st.integers(0, sum(segments) - 1))
    pack, place = Battery("x", tuple(segments)).place(cell)
    assert place_of(cell, segments) == (pack + 1, place + 1)
    assert render(Message("at-cell", cell=Cell(cell)), segments) == f"pack {pack + 1}, cell {place + 1}"


def test_a_cell_of_no_known_battery_is_named_by_its_number():
    assert render(Message("at-cell", cell=Cell(30))) == "cell 31"
    assert render(Message("at-cell", cell=Cell(38)), [18, 20]) == "cell 39"


def test_a_message_is_sent_with_its_english_text():
    message = Message("finding-cell-imbalance", cell=Cell(30), size=Quantity(10.0, "%", 0))
    sent = rendered(message, [12] * 8)
    assert sent.text == "pack 3, cell 7: SOC 10 % below the others from the start. Balance the cells"
    assert (sent.code, sent.args["cell"], sent.message) == ("finding-cell-imbalance", {"index": 30}, message)
    assert sentence(message, [12] * 8).text == "P" + sent.text[1:]


def test_a_text_without_a_code_is_sent_as_it_is():
    sent = rendered("No such file")
    assert (sent.code, sent.text, render(sent.message, language="nb")) == ("verbatim", "No such file", "No such file")
    assert coded("x") == Message("verbatim", text="x")
