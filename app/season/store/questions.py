"""The questions that come along: SQL of `questions.sql`, which says its form in its first line."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from app.errors import ConfigError
from app.season.store.store import Answer, Limits, SeasonStore, Value
from app.words import Message

FILE: Final = Path(__file__).with_suffix(".sql")
_PARAMETER: Final = re.compile(r"-- \$(\w+) = (.*?): (.*)")


@dataclass(frozen=True)
class Parameter:
    """What a question wants to know."""

    name: str
    default: str
    meaning: str


@dataclass(frozen=True)
class Question:
    """One of the questions that come along."""

    name: str
    meaning: str
    sql: str
    parameters: tuple[Parameter, ...]

    def values(self, given: Mapping[str, str]) -> dict[str, Value]:
        """Return the values of its parameters; a number where the default is one.

        Raises:
            ConfigError: it has no such parameter, or a number is none.
        """
        names = [each.name for each in self.parameters]
        for name in given:
            if name not in names:
                raise ConfigError(name, given[name], Message("one-of", choices=tuple(names)))
        return {each.name: _value(each, given.get(each.name, each.default)) for each in self.parameters}


def questions() -> list[Question]:
    """Return all of them, by name."""
    _, *texts = FILE.read_text(encoding="utf-8").split("\n\n")
    return [_read(text.splitlines()) for text in texts]


def find_question(name: str) -> Question | None:
    """Return the question of this name, None where there is none."""
    return next((each for each in questions() if each.name == name), None)


def parameters_of(question: Question) -> str:
    """Return what a command line can set, behind the question's meaning."""
    return "".join(f"; --set {each.name}={each.default}" for each in question.parameters)


def ask(store: SeasonStore, name: str, limits: Limits = Limits(), **given: str) -> Answer:  # noqa: B008
    """Answer one of the questions.

    Raises:
        ConfigError: there is none of this name, or a parameter is wrong.
        QueryFailed: see `SeasonStore.query`.
    """
    question = find_question(name)
    if question is None:
        raise ConfigError("question", name, Message("one-of", choices=tuple(each.name for each in questions())))
    return store.query(question.sql, question.values(given), limits)


def _read(lines: list[str]) -> Question:
    name, meaning = lines[0].removeprefix("-- ").split(": ", 1)
    parameters = [Parameter(*found.groups()) for line in lines if (found := _PARAMETER.match(line))]
    return Question(
        name, meaning, "\n".join(line for line in lines if not line.startswith("--")) + "\n", tuple(parameters)
    )


def _value(parameter: Parameter, text: str) -> Value:
    try:
        float(parameter.default)
    except ValueError:
        return text
    try:
        return float(text)
    except ValueError as error:
        raise ConfigError(parameter.name, text, Message("a-number")) from error
