"""The season's store: a lake that answers in SQL, by DuckDB or ClickHouse."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from app.season.lake.place import Place
from app.season.store.clickhouse_store import ClickHouseStore, in_process, server
from app.season.store.duckdb_store import DuckDBStore
from app.season.store.store import Answer, Limits, QueryFailed, SeasonError, SeasonStore

__all__ = ["ENGINES", "Answer", "Limits", "QueryFailed", "SeasonError", "SeasonStore", "open_store"]

ENGINES: Final = ("duckdb", "chdb")  # or the URL of a ClickHouse server


def open_store(lake: str | Path, engine: str = "duckdb") -> SeasonStore:
    """Return a lake as a store.

    Args:
        lake: folder or URL.
        engine: `duckdb`; `clickhouse[s]://[USER[:PASSWORD]@]HOST[:PORT][/DATABASE]`, a server that sees the lake under
            the same path; `chdb`, ClickHouse in this process.

    Raises:
        ExtraMissing: a package is not installed.
        ConfigError: lake or engine is not understood.
    """
    place = Place(lake)
    if engine == "duckdb":
        return DuckDBStore(place)
    return ClickHouseStore(place, in_process() if engine == "chdb" else server(engine))
