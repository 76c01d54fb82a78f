"""The questions that come along: SQL of `questions.sql`, which says its form in its first line."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from app.errors import ConfigError
from app.season.lake.place import LakeFolder
from app.season.store.store import Answer, QueryFailed, QueryLimits, SeasonStore, Value
from app.words import Message

FILE: Final = Path(__file__).with_suffix(".sql")
_PARAMETER: Final = re.compile(r"-- \$(\w+) = (.*?): (.*)")


@dataclass(frozen=True)
class Parameter:
    """A parameter of a question."""

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
        names = [parameter.name for parameter in self.parameters]
        for name in given:
            if name not in names:
                raise ConfigError(name, given[name], Message("one-of", choices=tuple(names)))
        return {
            parameter.name: _value(parameter, given.get(parameter.name, parameter.default))
            for parameter in self.parameters
        }


def questions() -> list[Question]:
    """Return all of them, by name."""
    _, *texts = FILE.read_text(encoding="utf-8").split("\n\n")
    return [_read(text.splitlines()) for text in texts]


def find_question(name: str) -> Question | None:
    """Return the question of this name, None where there is none."""
    return next((question for question in questions() if question.name == name), None)


def parameters_of(question: Question) -> str:
    """Return what a command line can set, behind the question's meaning."""
    return "".join(f" --set {parameter.name}={parameter.default}" for parameter in question.parameters)


def ask(store: SeasonStore, question: str, limits: QueryLimits = QueryLimits(), /, **given: str) -> Answer:  # noqa: B008
    """Answer one of the questions by its name, or one SELECT.

    Raises:
        ConfigError: there is none of this name, or a parameter is wrong.
        QueryFailed: see `SeasonStore.query`.
    """
    stored_question = find_question(question)
    if stored_question is not None:
        return store.query(stored_question.sql, stored_question.values(given), limits)
    if " " not in question.strip():
        names = tuple(question.name for question in questions())
        raise ConfigError("question", question, Message("sql-or-one-of", choices=names))
    return store.query(question, given, limits)


def json_of(answer: Answer) -> str:
    """Return an answer as JSON: `columns`, `rows` and `is_cut`."""
    document = {"columns": answer.table.column_names, "rows": answer.rows(), "is_cut": answer.is_cut}
    return json.dumps(document, default=str)


def answer_at(lake: str, question: str, given: Mapping[str, str], limits: QueryLimits, most_mb: int) -> str:
    """Return the answer of a service's lake, which may be empty, as JSON of at most `most_mb` megabytes.

    Raises:
        ConfigError, QueryFailed: as `ask`; the answer is longer.
    """
    LakeFolder(lake).make()
    text = json_of(ask(SeasonStore(lake), question, limits, **given))
    if len(text) > most_mb << 20:
        raise QueryFailed(Message("answer-too-large", megabytes=most_mb))
    return text


def _read(lines: list[str]) -> Question:
    name, meaning = lines[0].removeprefix("-- ").split(": ", 1)
    parameters = [Parameter(*match.groups()) for line in lines if (match := _PARAMETER.match(line))]
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
