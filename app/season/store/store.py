"""The season's store: a lake that answers in SQL, by DuckDB. It reads the lake and nothing else, and writes nothing.

SeasonError
  QueryFailed    the SQL is wrong, not allowed, or took too long
"""

from __future__ import annotations

import re
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Final

from app.errors import AppError, ConfigError, ExtraMissing
from app.season.lake.place import LakeFolder
from app.season.lake.schema import MARK, SAMPLES, TABLES, WHERE, LakeColumn, arrow_schema, name_of_table
from app.words import Message, Text

Value = str | int | float
_THREADS: Final = 2
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
class QueryLimits:
    """Limits of the cost of a query."""

    seconds: float = 60.0
    memory_mb: int = 1024
    rows: int | None = None  # rows of an answer; the rest is cut


@dataclass(frozen=True)
class Answer:
    """The rows of an answer as an Arrow table, and whether there were more than `QueryLimits.rows`."""

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
            [value.isoformat() if isinstance(value, datetime) else value for value in row]
            for row in zip(*columns, strict=True)
        ]


class SeasonStore:
    """A lake that can be asked in SQL: `sessions`, `laps`, `cells`, `events` and `samples` are its tables.

    What is built meanwhile is in the next answer.
    """

    def __init__(self, lake: str | Path) -> None:
        """Open a lake, a folder or URL; nothing is read yet.

        Raises:
            ExtraMissing: DuckDB is not installed.
            ConfigError: the lake is not understood.
        """
        try:
            import duckdb
        except ImportError as error:
            raise ExtraMissing(Message("the-season-lake"), "duckdb", "season") from error
        self._duckdb = duckdb
        self._lake = LakeFolder(lake)
        self._lock = threading.Lock()

    def query(
        self, sql: str, parameters: Mapping[str, Value] | None = None, limits: QueryLimits = QueryLimits()
    ) -> Answer:
        """Answer one SELECT.

        Args:
            sql: where `$name` stands for a value of `parameters`, and `"$name"` for a column of that name.
            parameters: by name.
            limits: what it may cost.

        Raises:
            QueryFailed: DuckDB refuses it, or a limit is passed.
            ConfigError: a parameter is missing.
        """
        text = with_parameters(sql, parameters or {})
        with self._lock:
            connection = self._connect(limits)
            stopper = threading.Timer(limits.seconds, connection.interrupt)
            try:
                self._check(connection, text)
                stopper.start()
                for table in TABLE_NAMES:
                    if mentions(text, table):
                        self._add_view(connection, table)
                return self._answer(connection, text, limits)
            except self._duckdb.InterruptException as error:
                raise QueryFailed(Message("query-too-long", seconds=limits.seconds)) from error
            except self._duckdb.OutOfMemoryException as error:
                raise QueryFailed(Message("query-too-large", megabytes=limits.memory_mb)) from error
            except self._duckdb.Error as error:
                raise QueryFailed(str(error).strip()) from error
            finally:
                stopper.cancel()
                connection.close()

    def _connect(self, limits: QueryLimits) -> Any:
        """Return a database in memory that reaches the lake and no other file, address or extension."""
        settings: dict[str, str | bool | int | float | list[str]] = {
            "temp_directory": "",
            "memory_limit": f"{limits.memory_mb}MB",
            "threads": _THREADS,
            "max_temp_directory_size": "0KB",
        }
        connection = self._duckdb.connect(":memory:", config=settings)
        if not self._lake.is_local:
            connection.register_filesystem(self._lake.fs)
        folder = self._url("").replace("'", "''")
        connection.execute("SET TimeZone = 'UTC'")
        connection.execute(f"SET allowed_directories = ['{folder}']")
        connection.execute("SET enable_external_access = false")
        connection.execute("SET lock_configuration = true")
        return connection

    def _check(self, connection: Any, text: str) -> None:
        """One statement that reads; EXPLAIN is none: with ANALYZE it runs what it explains, also a COPY into the lake.

        Raises:
            QueryFailed: it is something else.
        """
        kinds = [statement.type for statement in connection.extract_statements(text)]
        if kinds != [self._duckdb.StatementType.SELECT]:
            raise QueryFailed(Message("one-select"))

    def _add_view(self, connection: Any, table: str) -> None:
        file = name_of_table(table)
        files = self._lake.find(f"car=*/season=*/session=*/{file}")
        if not files:
            connection.register(table, arrow_schema(columns_of(table)).empty_table())
            return
        rows = self._rows(file)
        if table == SAMPLES:  # batteries have different signals; to look at the columns of every file takes a second
            layouts = connection.sql(f"SELECT DISTINCT layout {self._rows(name_of_table(MARK))}").fetchall()
            rows = self._rows(file, union=len(layouts) != 1)
        connection.execute(f"CREATE VIEW {table} AS SELECT * {rows}")

    def _rows(self, file: str, *, union: bool = False) -> str:
        pattern = self._url(f"car=*/season=*/session=*/{file}").replace("'", "''")
        return f"FROM read_parquet('{pattern}', hive_partitioning = false, union_by_name = {str(union).lower()})"

    def _answer(self, connection: Any, text: str, limits: QueryLimits) -> Answer:
        relation = connection.sql(text)
        if limits.rows is None:
            return Answer(relation.to_arrow_table())
        table = relation.limit(limits.rows + 1).to_arrow_table()
        return Answer(table.slice(0, limits.rows), table.num_rows > limits.rows)

    def _url(self, name: str) -> str:
        """A path as DuckDB names it: with the protocol where its file system is one of fsspec's."""
        path = self._lake.path(name)
        return path if self._lake.is_local else str(self._lake.fs.unstrip_protocol(path))


def columns_of(table: str) -> tuple[LakeColumn, ...]:
    """Return the columns of a table that are always there."""
    return TABLES[table] if table in TABLES else (*WHERE, LakeColumn("time", "time", "", ""))


def mentions(sql: str, table: str) -> bool:
    """Return whether a table may be asked for: its name stands somewhere in the text."""
    return re.search(rf"\b{table}\b", sql, re.IGNORECASE) is not None


def with_parameters(sql: str, parameters: Mapping[str, Value]) -> str:
    """Put values in the place of `$name`, and names of columns in the place of `"$name"`.

    Raises:
        ConfigError: one is missing, or a number is none.
    """

    def put(match: re.Match[str]) -> str:
        name = match["name"]
        if name not in parameters:
            raise ConfigError(name, None, Message("parameter-missing"))
        value = parameters[name]
        if match["quote"]:
            return '"' + str(value).replace('"', '""') + '"'
        if isinstance(value, str):
            if "\\" in value:  # engines differ in how they escape it
                raise ConfigError(name, value, Message("no-backslash"))
            return "'" + value.replace("'", "''") + "'"
        if value != value or abs(value) == float("inf"):
            raise ConfigError(name, value, Message("a-number"))
        return repr(value)

    return _PARAMETER.sub(put, sql)
