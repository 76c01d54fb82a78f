import json
from dataclasses import asdict

import orjson
import pytest

from app.words.message import Cell, Message, Pack, Quantity, json_args, message_from_json

NESTED = Message(
    "config-write-failed",
    who="Kari",
    n=2,
    cells=(Cell(0), Cell(95)),
    pack=Pack(7),
    value=Quantity(2.49, "V", 2),
    nothing=None,
    error=Message("link-lost", name="RS232"),
)


def test_a_message_comes_back_from_json_whole():
    assert message_from_json(json.loads(json.dumps(asdict(NESTED)))) == NESTED
    assert message_from_json(asdict(NESTED)) == NESTED


def test_every_encoder_writes_the_same_form():
    form = json.loads(json.dumps(asdict(NESTED)))
    assert orjson.loads(orjson.dumps(NESTED)) == form
    assert {"code": NESTED.code, "args": json_args(NESTED)} == form


def test_the_place_that_earlier_versions_stored_with_a_cell_is_left_out():
    stored = {"code": "x", "args": {"cell": {"index": 19, "pack": 2, "cell": 2}}}
    assert message_from_json(stored) == Message("x", cell=Cell(19))


def test_what_is_no_message_is_refused():
    with pytest.raises(KeyError):
        message_from_json({"code": "no arguments"})


def test_equal_messages_are_one_in_a_set():
    assert {Message("a", n=1), Message("a", n=1), Message("a", n=2)} == {Message("a", n=1), Message("a", n=2)}
