"""Against a real server, with a few connections for many and tenths of a second for ten seconds."""

import asyncio
import contextlib
import socket
import threading

import httpx
import pytest
import uvicorn
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from app.api.web import http_protocol, websocket_protocol
from app.api.web.connection_limits import ClientConnections
from app.api.web.http_protocol import HttpProtocol
from app.api.web.websocket_protocol import LiveProtocol
from tests.service_process import until

MOST = 20
OWN = MOST // 2  # of one address


async def app(scope, receive, send):
    if scope["type"] == "websocket":
        await send({"type": "websocket.accept"})
        while (await receive())["type"] != "websocket.disconnect":
            pass
        return
    if scope["type"] == "lifespan":
        return
    while (message := await receive()).get("more_body"):
        if message["type"] == "http.disconnect":
            return
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": b"well"})


class Served:
    def __init__(self):
        config = uvicorn.Config(
            app,
            http=HttpProtocol,
            ws=LiveProtocol,
            ws_per_message_deflate=False,
            limit_concurrency=MOST,
            lifespan="off",
            log_config=None,
        )
        self.server = uvicorn.Server(config)
        self.server.server_state.connections = ClientConnections()
        listener = socket.create_server(("127.0.0.1", 0))
        self.address = listener.getsockname()
        self.thread = threading.Thread(target=lambda: asyncio.run(self.server._serve([listener])))
        self.thread.start()
        until(lambda: self.server.started)

    def open(self, first=b""):
        made = socket.create_connection(self.address, timeout=20)
        made.sendall(first)
        return made

    def get(self):
        return httpx.get("http://{}:{}/".format(*self.address)).status_code

    @property
    def held(self):
        return len(self.server.server_state.connections)


@pytest.fixture
def served():
    one = Served()
    yield one
    one.server.should_exit = True
    one.thread.join()


@pytest.fixture
def hurry(monkeypatch):
    for name in ("REQUEST_S", "BODY_S", "ANSWER_S"):
        monkeypatch.setattr(http_protocol, name, 0.2)


def is_closed(connection):
    """Wait until the other side has closed."""
    with connection, contextlib.suppress(ConnectionError):
        while connection.recv(4096):
            pass
    return True


def test_silent_connections_keep_nobody_out(served):
    silent = [served.open() for _ in range(5 * MOST)]
    assert served.get() == 200
    assert served.held <= OWN
    assert is_closed(silent[0])  # the one that waited longest made room
    for each in silent:
        each.close()


@pytest.mark.parametrize(
    "said",
    [b"", b"GET / HT", b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 100\r\n\r\nslow"],
    ids=["nothing", "half of a header", "half of a body"],
)
def test_who_is_too_slow_is_cut_off(served, hurry, said):
    assert is_closed(served.open(said))
    until(lambda: served.held == 0)


def test_a_connection_that_asks_no_more_is_closed(served, hurry):
    asked = served.open(b"GET / HTTP/1.1\r\nHost: x\r\n\r\n")
    until(lambda: served.server.server_state.total_requests == 1)
    assert asked.recv(4096).startswith(b"HTTP/1.1 200")
    assert is_closed(asked)


def test_websockets_leave_room_for_requests(served):
    url = "ws://{}:{}/".format(*served.address)
    with contextlib.ExitStack() as stack:
        for _ in range(OWN * 3 // 4):
            stack.enter_context(connect(url))
        with pytest.raises(InvalidStatus, match="503"):
            connect(url)
        assert served.get() == 200


def test_a_reader_that_talks_without_end_is_cut_off(served, monkeypatch):
    monkeypatch.setattr(websocket_protocol, "SENT_BYTES", 10_000)
    with connect("ws://{}:{}/".format(*served.address)) as talker:
        with contextlib.suppress(ConnectionClosed):
            for _ in range(100):
                talker.send("x" * 1000)
        with pytest.raises(ConnectionClosed):
            talker.recv(timeout=20)
