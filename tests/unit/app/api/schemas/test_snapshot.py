from dataclasses import dataclass
from typing import Annotated

import pytest
from pydantic import ValidationError

from app.api.schemas.snapshot import SnapshotOut, model_of
from app.telemetry import BoolArray, FloatArray
from app.telemetry.fields import INTERNAL, SentAs, Unit


@dataclass(frozen=True)
class Inner:
    """One of them."""

    text: str | None


@dataclass(frozen=True)
class Outer:
    """All of them.

    What follows the first line is not for the page.
    """

    t_ns: Annotated[int, SentAs("time", 1e9)]
    volts: Annotated[FloatArray, Unit("V", "cell voltage")]
    flags: BoolArray | None
    inner: Inner | None
    rows: tuple[Inner, ...]
    raw: Annotated[bytes, INTERNAL]


def test_a_model_has_the_names_types_and_meanings_of_what_is_sent():
    schema = model_of(Outer).model_json_schema()
    number = {"anyOf": [{"type": "number"}, {"type": "null"}]}
    properties = schema["properties"]
    assert (schema["title"], schema["description"]) == ("OuterOut", "All of them.")
    assert list(properties) == schema["required"] == ["time", "volts", "flags", "inner", "rows"]
    assert properties["time"]["type"] == "number"
    assert (properties["volts"]["items"], properties["volts"]["unit"]) == (number, "V")
    assert properties["volts"]["description"] == "cell voltage"
    assert properties["flags"]["items"]["anyOf"][0] == {"type": "boolean"}
    assert properties["inner"]["anyOf"] == [{"$ref": "#/$defs/InnerOut"}, {"type": "null"}]
    assert properties["rows"]["items"] == {"$ref": "#/$defs/InnerOut"}


def test_a_dataclass_is_taken_as_an_answer():
    assert model_of(Inner).model_validate(Inner("x")).model_dump() == {"text": "x"}


def test_a_key_that_is_missing_is_not_a_snapshot():
    with pytest.raises(ValidationError, match="accumulator"):
        SnapshotOut.model_validate({"seq": 1})
