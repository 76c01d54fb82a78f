"""How a ClickHouse server is asked over HTTP, seen from the other side of the line."""

from collections.abc import Iterator
from typing import NamedTuple
from urllib.parse import parse_qsl, urlsplit

import pyarrow as pa
import pytest

from app.season.lake.place import Place
from app.season.store import Limits, QueryFailed
from app.season.store.clickhouse_store import ClickHouseStore, server
from tests.http_stub import Answer, Asked, http_stub


class Server(NamedTuple):
    """Answers every statement with one row, or with an error where it holds `wrong`."""

    place: str  # host and port
    asked: list[tuple[dict[str, str], str, str]]


@pytest.fixture
def running() -> Iterator[Server]:
    asked = []

    def answer(request: Asked) -> Answer:
        statement = request.body.decode()
        asked.append((dict(parse_qsl(urlsplit(request.path).query)), request.headers["Authorization"], statement))
        if "wrong" in statement:
            return 404, {}, b"Code: 47. DB::Exception: Unknown identifier"
        sink = pa.BufferOutputStream()
        with pa.ipc.new_stream(sink, pa.schema([("n", pa.int64())])) as writer:
            writer.write_batch(pa.record_batch([[1, 2, 3]], names=["n"]))
        return 200, {}, sink.getvalue().to_pybytes()

    with http_stub(answer) as url:
        yield Server(url.removeprefix("http://"), asked)


def test_a_server_gets_the_statement_its_limits_and_who_asks(running, lake):
    store = ClickHouseStore(Place(lake), server(f"clickhouse://anna:p%40ss@{running.place}/season"))
    answer = store.query("SELECT count(*) AS n FROM cells", limits=Limits(seconds=5.0, memory_mb=100, rows=2))
    assert (answer.rows(), answer.is_cut) == ([[1], [2]], True)
    ((settings, login, statement),) = running.asked
    assert statement.startswith("WITH cells AS (SELECT * FROM file('")
    assert statement.endswith(") SELECT count(*) AS n FROM cells")
    assert login == "Basic YW5uYTpwQHNz"
    wanted = {"database": "season", "readonly": "2", "max_execution_time": "5", "limit": "3"}
    assert settings.items() >= (wanted | {"max_memory_usage": "100000000", "default_format": "ArrowStream"}).items()


def test_what_a_server_refuses_is_said(running, lake):
    store = ClickHouseStore(Place(lake), server(f"clickhouse://{running.place}"))
    with pytest.raises(QueryFailed, match="Unknown identifier"):
        store.query("SELECT wrong FROM cells")


def test_a_server_that_is_not_there_is_named(lake):
    with pytest.raises(QueryFailed, match=r"127\.0\.0\.1"):
        ClickHouseStore(Place(lake), server("clickhouse://127.0.0.1:1")).query("SELECT 1")
