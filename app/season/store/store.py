"""What every engine of the season does: answers SQL over the tables of a lake, and changes nothing.

SeasonError
  QueryFailed    the SQL is wrong, not allowed, or took too long
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Final, Protocol

from app.errors import AppError, ConfigError
from app.season.lake.schema import SAMPLES, TABLES, WHERE, Column
from app.words import Message, Text

Value = str | int | float
TABLE_NAMES: Final = (*TABLES, SAMPLES)
_PARAMETER: Final = re.compile(r"""(?P<quote>"?)\$(?P<name>[A-Za-z_]\w*)(?P=quote)""")


class SeasonError(AppError):
    """Root of the errors of the season."""


class QueryFailed(SeasonError):
    """A question was not answered."""

    def __init__(self, reason: Text) -> None:
        self.reason = reason
        super().__init__(Message("query-failed", reason=reason))


@dataclass(frozen=True)
class Limits:
    """What a question may cost."""

    seconds: float = 60.0
    memory_mb: int = 1024
    rows: int | None = None  # of the answer; what is beyond is cut


@dataclass(frozen=True)
class Answer:
    """The rows of an answer as an Arrow table, and whether there were more than `Limits.rows`."""

    table: Any
    is_cut: bool = False

    def rows(self) -> list[list[object]]:
        """Return the rows as plain values, times as ISO 8601 in UTC.

        Raises:
            QueryFailed: a value is none that Python knows, as the year 290000.
        """
        try:
            columns = [column.to_pylist() for column in self.table.columns]
        except (OverflowError, ValueError) as error:
            raise QueryFailed(str(error)) from error
        return [
            [each.isoformat() if isinstance(each, datetime) else each for each in row]
            for row in zip(*columns, strict=True)
        ]


class SeasonStore(Protocol):
    """A lake that can be asked in SQL: `sessions`, `laps`, `cells`, `events` and `samples` are its tables."""

    engine: str

    def query(self, sql: str, parameters: Mapping[str, Value] | None = None, limits: Limits = Limits()) -> Answer:
        """Answer one SELECT.

        Args:
            sql: where `$name` stands for a value of `parameters`, and `"$name"` for a column of that name.
            parameters: by name.
            limits: what it may cost.

        Raises:
            QueryFailed: the engine refuses it, or a limit is passed.
            ConfigError: a parameter is missing.
        """
        ...

    def close(self) -> None:
        """Let go of the engine."""
        ...


def columns_of(table: str) -> tuple[Column, ...]:
    """Return the columns of a table that are always there."""
    return TABLES[table] if table in TABLES else (*WHERE, Column("time", "time", "", ""))


def mentions(sql: str, table: str) -> bool:
    """Whether a table may be asked for: its name stands somewhere in the text."""
    return re.search(rf"\b{table}\b", sql, re.IGNORECASE) is not None


def with_parameters(sql: str, parameters: Mapping[str, Value]) -> str:
    """Put values in the place of `$name`, and names of columns in the place of `"$name"`.

    Raises:
        ConfigError: one is missing, or a number is none.
    """

    def put(found: re.Match[str]) -> str:
        name = found["name"]
        if name not in parameters:
            raise ConfigError(name, None, Message("parameter-missing"))
        value = parameters[name]
        if found["quote"]:
            return '"' + str(value).replace('"', '""') + '"'
        if isinstance(value, str):
            if "\\" in value:  # of which engines think differently
                raise ConfigError(name, value, Message("no-backslash"))
            return "'" + value.replace("'", "''") + "'"
        if value != value or abs(value) == float("inf"):
            raise ConfigError(name, value, Message("a-number"))
        return repr(value)

    return _PARAMETER.sub(put, sql)
