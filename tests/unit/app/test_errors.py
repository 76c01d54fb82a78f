"""What is wrong with an input, in words of ours: nothing of pydantic's reaches a person."""

from typing import Literal

import pytest
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from app.errors import MEANINGS, MasterRefused, validation_text
from app.words import render
from firmware_protocol.messages import Result


class Input(BaseModel):
    model_config = ConfigDict(extra="forbid")
    port: int = Field(default=1, ge=0, le=9)
    rate: float = Field(default=1.0, gt=0, lt=9)
    order: Literal["oldest", "newest"] = "oldest"
    name: str = ""
    is_on: bool = False


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"port": 10}, "must be at most 9"),
        ({"port": -1}, "must be at least 0"),
        ({"port": "x"}, "must be a whole number"),
        ({"rate": 0}, "must be above 0"),
        ({"rate": 9}, "must be below 9"),
        ({"rate": "x"}, "must be a number"),
        ({"order": "x"}, "must be one of oldest or newest"),
        ({"name": 1}, "must be a text"),
        ({"is_on": "x"}, "must be true or false"),
        ({"colour": 1}, "unknown field"),
    ],
)
def test_a_wrong_input_is_named_in_our_words(given, text):
    with pytest.raises(ValidationError) as caught:
        Input.model_validate(given)
    (error,) = caught.value.errors()
    assert render(validation_text(error)) == text


@pytest.mark.parametrize("result", sorted(set(Result) - {Result.DONE}))
def test_no_refusal_of_the_master_shows_the_name_of_its_code(result):
    assert result.name in MEANINGS
    for offset in (None, 4):
        assert result.name not in str(MasterRefused("WRITE", result.name, offset))
