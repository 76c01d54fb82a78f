"""How a ClickHouse server is asked over HTTP, seen from the other side of the line."""

import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from urllib.parse import parse_qsl, urlsplit

import pyarrow as pa
import pytest

from app.season.lake.place import Place
from app.season.store import Limits, QueryFailed
from app.season.store.clickhouse_store import ClickHouseStore, server


class Server(HTTPServer):
    """Answers every statement with one row, or with an error where it holds `wrong`."""

    asked: list[tuple[dict[str, str], str, str]]


class Handler(BaseHTTPRequestHandler):
    server: Server

    def do_POST(self) -> None:
        statement = self.rfile.read(int(self.headers["Content-Length"])).decode()
        settings = dict(parse_qsl(urlsplit(self.path).query))
        self.server.asked.append((settings, self.headers["Authorization"], statement))
        sink = pa.BufferOutputStream()
        with pa.ipc.new_stream(sink, pa.schema([("n", pa.int64())])) as writer:
            writer.write_batch(pa.record_batch([[1, 2, 3]], names=["n"]))
        is_wrong = "wrong" in statement
        body = b"Code: 47. DB::Exception: Unknown identifier" if is_wrong else sink.getvalue().to_pybytes()
        self.send_response(404 if is_wrong else 200)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def running() -> Iterator[Server]:
    with Server(("127.0.0.1", 0), Handler) as made:
        made.asked = []
        thread = threading.Thread(target=made.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield made
        made.shutdown()
        thread.join()


def test_a_server_gets_the_statement_its_limits_and_who_asks(running, lake):
    store = ClickHouseStore(Place(lake), server(f"clickhouse://anna:p%40ss@127.0.0.1:{running.server_port}/season"))
    answer = store.query("SELECT count(*) AS n FROM cells", limits=Limits(seconds=5.0, memory_mb=100, rows=2))
    assert (answer.rows(), answer.is_cut) == ([[1], [2]], True)
    ((settings, login, statement),) = running.asked
    assert statement.startswith("WITH cells AS (SELECT * FROM file('")
    assert statement.endswith(") SELECT count(*) AS n FROM cells")
    assert login == "Basic YW5uYTpwQHNz"
    wanted = {"database": "season", "readonly": "2", "max_execution_time": "5", "limit": "3"}
    assert settings.items() >= (wanted | {"max_memory_usage": "100000000", "default_format": "ArrowStream"}).items()


def test_what_a_server_refuses_is_said(running, lake):
    store = ClickHouseStore(Place(lake), server(f"clickhouse://127.0.0.1:{running.server_port}"))
    with pytest.raises(QueryFailed, match="Unknown identifier"):
        store.query("SELECT wrong FROM cells")


def test_a_server_that_is_not_there_is_named(lake):
    with pytest.raises(QueryFailed, match=r"127\.0\.0\.1"):
        ClickHouseStore(Place(lake), server("clickhouse://127.0.0.1:1")).query("SELECT 1")
