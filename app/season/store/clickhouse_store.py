"""ClickHouse over the same files: a server by URL, or the engine in this process by chdb.

A server has to see the lake under the same path or URL as this program does. Who may read what is the matter of its
users: give it one that may only read. What stands here refuses everything but one SELECT.
"""

from __future__ import annotations

import importlib
import re
from base64 import b64encode
from collections.abc import Callable, Mapping
from typing import Any, Final

from app.errors import ConfigError, ExtraMissing
from app.season.lake.arrow import name_of_table, pyarrow_or_error
from app.season.lake.place import Place
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

Run = Callable[[str, Mapping[str, str]], bytes]  # a statement and its settings; the answer as an Arrow stream
_SELECT: Final = re.compile(r"(?:\s|--[^\n]*+\n|(?>/\*.*?\*/))*+(SELECT|WITH)\b", re.IGNORECASE | re.DOTALL)
_ALWAYS: Final = {  # as DuckDB does: null where there is nothing, columns of all files
    "aggregate_functions_null_for_empty": "1",
    "join_use_nulls": "1",
    "schema_inference_mode": "union",
    "use_hive_partitioning": "0",
    "session_timezone": "UTC",
    "output_format_arrow_string_as_string": "1",
}
_TYPES: Final = {"text": "String", "number": "Float64", "count": "Int32", "time": "DateTime64(6)", "flag": "Bool"}


class ClickHouseStore:
    """Answers over the files of a lake."""

    engine = "clickhouse"

    def __init__(self, lake: Place, run: Run) -> None:
        """Ask by `run`, which is `server(URL)` or `in_process()`."""
        pyarrow_or_error()
        self._lake = lake
        self._run = run

    def query(self, sql: str, parameters: Mapping[str, Value] | None = None, limits: Limits = Limits()) -> Answer:  # noqa: B008
        """Answer one SELECT: see `SeasonStore.query`."""
        import pyarrow

        text = with_parameters(sql, parameters or {}).strip().rstrip(";").rstrip()
        kind = _SELECT.match(text)
        if kind is None or ";" in _without_literals(text):
            raise QueryFailed(Message("one-select"))
        settings = {
            **_ALWAYS,
            "max_execution_time": f"{limits.seconds:g}",
            "max_memory_usage": str(limits.memory_mb * 1_000_000),
            "limit": str(0 if limits.rows is None else limits.rows + 1),
        }
        tables = ", ".join(f"{table} AS ({self._rows(table)})" for table in TABLE_NAMES if mentions(text, table))
        if tables:
            more = kind[2].upper() == "WITH"
            text = f"WITH {tables}, {text[kind.end() :]}" if more else f"WITH {tables} {text}"
        answer = self._run(text, settings)
        table = pyarrow.ipc.open_stream(answer).read_all() if answer else pyarrow.table({})
        is_cut = limits.rows is not None and table.num_rows > limits.rows
        return Answer(table.slice(0, limits.rows) if is_cut else table, is_cut)

    def close(self) -> None:
        """Nothing is held between two questions."""

    def _rows(self, table: str) -> str:
        file = f"car=*/season=*/session=*/{name_of_table(table)}"
        if not self._lake.find(file):
            empty = ", ".join(
                f"CAST(NULL, 'Nullable({_TYPES[each.type]})') AS {each.name}" for each in columns_of(table)
            )
            return f"SELECT {empty} WHERE 0"
        path = self._lake.path(file).replace("'", "\\'")
        function = "file" if self._lake.is_local else "s3"
        where = path if self._lake.is_local else str(self._lake.fs.unstrip_protocol(path))
        return f"SELECT * FROM {function}('{where}', 'Parquet')"


def server(url: str) -> Run:
    """Return how a server is asked by its HTTP interface: `clickhouse[s]://[USER[:PASSWORD]@]HOST[:8123][/DATABASE]`.

    Raises:
        ConfigError: the URL is none of this kind.
    """
    import urllib.error  # for a server alone: they take a tenth of what the first answer of a season takes
    import urllib.parse
    import urllib.request

    parts = urllib.parse.urlsplit(url)
    if parts.scheme not in ("clickhouse", "clickhouses") or not parts.hostname:
        raise ConfigError("store", url, Message("clickhouse-url"))
    scheme, port = ("https", 8443) if parts.scheme == "clickhouses" else ("http", 8123)
    address = f"{scheme}://{parts.hostname}:{parts.port or port}/"
    login = f"{urllib.parse.unquote(parts.username or 'default')}:{urllib.parse.unquote(parts.password or '')}"
    headers = {"Authorization": "Basic " + b64encode(login.encode()).decode()}
    database = {"database": parts.path.strip("/")} if parts.path.strip("/") else {}

    def run(statement: str, settings: Mapping[str, str]) -> bytes:
        given = {**settings, **database, "default_format": "ArrowStream", "readonly": "2"}
        where = f"{address}?{urllib.parse.urlencode(given)}"
        request = urllib.request.Request(where, statement.encode(), headers)
        try:
            with urllib.request.urlopen(request, timeout=float(settings["max_execution_time"]) + 10.0) as answer:
                return bytes(answer.read())
        except urllib.error.HTTPError as error:
            raise QueryFailed(error.read(2000).decode(errors="replace").strip()) from error
        except OSError as error:
            raise QueryFailed(f"{parts.hostname}: {error}") from error

    return run


def in_process() -> Run:
    """Return how ClickHouse is asked in this process.

    Raises:
        ExtraMissing: chdb is not installed.
    """
    try:
        chdb: Any = importlib.import_module("chdb")
    except ImportError as error:
        raise ExtraMissing("ClickHouse", "chdb", "clickhouse") from error

    def run(statement: str, settings: Mapping[str, str]) -> bytes:
        given = ", ".join(f"{name} = '{value}'" for name, value in settings.items())
        try:
            return bytes(chdb.query(f"{statement} SETTINGS {given}", "ArrowStream").bytes())
        except RuntimeError as error:
            raise QueryFailed(str(error).strip()) from error

    return run


def _without_literals(text: str) -> str:
    return re.sub(r"'(?:[^'\\]|\\.|'')*'|\"[^\"]*\"|--[^\n]*", "", text)
