"""DuckDB, embedded: the default engine. It reads the lake and nothing else, and writes nothing."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Any, Final

from app.errors import ExtraMissing
from app.season.lake.arrow import arrow_schema, name_of_table
from app.season.lake.place import Place
from app.season.lake.schema import MARK, SAMPLES
from app.season.store.store import (
    TABLE_NAMES,
    Answer,
    Limits,
    QueryFailed,
    Value,
    columns_of,
    mentions,
    with_parameters,
)
from app.words import Message

_THREADS: Final = 2


class DuckDBStore:
    """Answers over the files of a lake; what is built meanwhile is in the next answer."""

    engine = "duckdb"

    def __init__(self, lake: Place) -> None:
        """Open a lake; nothing is read yet.

        Raises:
            ExtraMissing: DuckDB is not installed.
        """
        try:
            import duckdb
        except ImportError as error:
            raise ExtraMissing(Message("the-season-lake"), "duckdb", "season") from error
        self._duckdb = duckdb
        self._lake = lake
        self._lock = threading.Lock()

    def query(self, sql: str, parameters: Mapping[str, Value] | None = None, limits: Limits = Limits()) -> Answer:  # noqa: B008
        """Answer one SELECT: see `SeasonStore.query`."""
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

    def close(self) -> None:
        """Nothing is held between two questions."""

    def _connect(self, limits: Limits) -> Any:
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
        found = self._lake.find(f"car=*/season=*/session=*/{file}")
        if not found:
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

    def _answer(self, connection: Any, text: str, limits: Limits) -> Answer:
        relation = connection.sql(text)
        if limits.rows is None:
            return Answer(relation.to_arrow_table())
        table = relation.limit(limits.rows + 1).to_arrow_table()
        return Answer(table.slice(0, limits.rows), table.num_rows > limits.rows)

    def _url(self, name: str) -> str:
        """A path as DuckDB names it: with the protocol where its file system is one of fsspec's."""
        path = self._lake.path(name)
        return path if self._lake.is_local else str(self._lake.fs.unstrip_protocol(path))
