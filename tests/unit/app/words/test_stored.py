"""Messages that were stored beside their English text, by this version and by others."""

import json
from dataclasses import asdict

import pytest

from app.words import Argument, Message, message_or_text

KNOWN = Message("replay-failed", session="run", error="no such file")
WITHDRAWN = Message("no-code-of-this-version", names=("a",))


def stored(message: Message) -> str:
    return json.dumps(asdict(message))


def test_a_stored_message_is_read_in_the_language_of_its_reader() -> None:
    assert message_or_text("the replay failed", stored(KNOWN)) == KNOWN


@pytest.mark.parametrize("argument", [WITHDRAWN, (1.0, WITHDRAWN)])
def test_one_with_a_code_that_this_version_has_not_is_its_english_text(argument: Argument) -> None:
    assert message_or_text("silent: a", stored(WITHDRAWN)) == "silent: a"
    within = Message("replay-failed", session="run", error=argument)
    assert message_or_text("failed: silent: a", stored(within)) == "failed: silent: a"
