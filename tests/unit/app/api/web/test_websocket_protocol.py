"""Frames as they go over the wire, and a reader that stands still: against a real server with tenths of a second."""

import asyncio
import contextlib
import gc
import socket
import ssl
import threading
import time
import weakref

import pytest
import uvicorn
from hypothesis import given
from hypothesis import strategies as st
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from app.api.access.certificate import own_certificate
from app.api.web import websocket_protocol
from app.api.web.connection_limits import ClientConnections
from app.api.web.http_protocol import HttpProtocol
from app.api.web.tls_protocol import tls_protocol
from app.api.web.websocket_protocol import READER, LiveProtocol, text_frame
from app.commands.console.tls import context_of
from tests.service_process import until

LONG = b'{"v": [' + b"3.7012, " * 200_000 + b"0]}"
HANDSHAKE = (
    b"GET / HTTP/1.1\r\nHost: x\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
)


class Served:
    """A server whose readers are handed to the test."""

    def __init__(self, certificate=None):
        self.readers, self.ends = [], []
        self.context = None if certificate is None else ssl.create_default_context(cafile=certificate.certificate)
        options = {"ws_max_size": 1 << 16, "lifespan": "off", "log_config": None, "interface": "asgi3"}
        http = HttpProtocol if certificate is None else tls_protocol(context_of(certificate))
        config = uvicorn.Config(self.app, http=http, ws=LiveProtocol, ws_per_message_deflate=False, **options)
        self.server = uvicorn.Server(config)
        self.server.server_state.connections = ClientConnections()
        listener = socket.create_server(("127.0.0.1", 0))
        self.address = listener.getsockname()
        self.url = "{}://{}:{}/".format("ws" if certificate is None else "wss", *self.address)
        self.thread = threading.Thread(target=lambda: asyncio.run(self.server._serve([listener])))
        self.thread.start()
        until(lambda: self.server.started)

    async def app(self, scope, receive, send):
        await send({"type": "websocket.accept"})
        self.readers.append(scope[READER])
        while (await receive())["type"] != "websocket.disconnect":
            pass

    async def hand_over(self, scope, receive, send):
        await send({"type": "websocket.accept"})
        reader = scope[READER]
        reader.hand_over(lambda: self.ends.append(id(reader)))
        self.readers.append(reader)

    def connect(self, **options):
        """A client; its two threads share a TLS object that Python 3.11 does not lock: one in 500 loses its request."""
        for _ in range(3):
            with contextlib.suppress(TimeoutError):
                return connect(self.url, ssl=self.context, open_timeout=5, **options)
        return connect(self.url, ssl=self.context, **options)

    def reader(self):
        until(lambda: self.readers)
        return self.readers[-1]

    def on_loop(self, call, *arguments):
        """Call on the server's loop and return what it returned."""

        async def run():
            return call(*arguments)

        return asyncio.run_coroutine_threadsafe(run(), self.reader().loop).result(20)


@pytest.fixture(scope="module")
def certificate(tmp_path_factory):
    return own_certificate(tmp_path_factory.mktemp("tls"), ["127.0.0.1"], time.time())


@pytest.fixture(params=["ws", "wss"])
def served(request, certificate):
    one = Served(certificate if request.param == "wss" else None)
    yield one
    one.server.should_exit = True
    one.thread.join()


@given(st.binary(max_size=70_000).map(lambda data: data.hex().encode()))
def test_a_frame_is_the_message_whether_it_is_compressed_or_not(body):
    plain, compressed = text_frame(body, False), text_frame(body, True)
    assert plain.endswith(body)
    assert (plain[0], compressed[0]) == (0x81, 0xC1)


@pytest.mark.parametrize("compression", [None, "deflate"])
def test_a_client_reads_what_was_framed_for_all(served, compression):
    with served.connect(compression=compression, max_size=None) as client:
        is_compressed = served.reader().is_compressed
        assert is_compressed is (compression is not None)
        for body in (b"{}", LONG):
            assert served.on_loop(served.reader().write_frame, text_frame(body, is_compressed))
            assert client.recv(timeout=20).encode() == body


def stand_still(served):
    """A reader that shakes hands and takes nothing of a long message."""
    made = socket.socket()
    made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    made.connect(served.address)
    if served.context is not None:
        made = served.context.wrap_socket(made, server_hostname="127.0.0.1")
    made.sendall(HANDSHAKE)
    assert served.on_loop(served.reader().write_frame, text_frame(LONG, False))
    return made


def rest_of(made):
    found = bytearray()
    made.settimeout(20)
    with contextlib.suppress(ConnectionError):
        while data := made.recv(1 << 16):
            found += data
    return bytes(found)


def test_a_reader_that_stands_still_takes_no_second_message_and_then_goes_on(served):
    woken = []
    with stand_still(served) as made:
        reader = served.reader()
        reader.on_drained = lambda: woken.append(True)
        assert not served.on_loop(reader.write_frame, text_frame(b"missed", False))
        assert reader.transport.get_write_buffer_size() <= len(LONG) + 4096
        made.settimeout(0.2)
        while not woken:
            with contextlib.suppress(TimeoutError):
                made.recv(1 << 16)
        made.settimeout(20)
        assert served.on_loop(reader.write_frame, text_frame(b"next", False))
        got = b""
        while not got.endswith(b"next"):
            got = got[-len("missed") :] + made.recv(1 << 16)
            assert b"missed" not in got


def test_one_that_wakes_up_in_time_learns_that_it_was_too_slow(served, monkeypatch):
    monkeypatch.setattr(websocket_protocol, "SLOW_S", 0.05)
    with stand_still(served) as made:
        served.reader().close_timeout = 0.1  # which is for the answer to the close
        until(lambda: served.reader().close_sent)
        assert rest_of(made).endswith(b"\x03\xf5too slow")  # 1013


def test_one_that_does_not_is_cut_off(served, monkeypatch):
    monkeypatch.setattr(websocket_protocol, "SLOW_S", 0.05)
    monkeypatch.setattr(websocket_protocol, "STALL_S", 0.1)
    with stand_still(served) as made:
        until(lambda: served.reader().disconnected)
        assert not rest_of(made).endswith(LONG[-100:])


def test_an_end_tells_why(served):
    with served.connect() as client:
        served.on_loop(served.reader().end, 4401, "logged out")
        with pytest.raises(ConnectionClosed) as closed:
            client.recv(timeout=20)
        assert not served.on_loop(served.reader().write_frame, b"")
    assert (closed.value.rcvd.code, closed.value.rcvd.reason) == (4401, "logged out")


@pytest.mark.parametrize("who", ["client", "server"])
def test_a_stream_goes_on_without_its_application_and_tells_its_end_once(served, who):
    served.server.config.loaded_app = served.hand_over
    with served.connect(compression=None) as client:
        reader = served.reader()
        until(lambda: not served.server.server_state.tasks)
        for _ in range(3):  # more than would be read while nobody takes it
            client.send("x" * 1000)
        assert served.on_loop(reader.write_frame, text_frame(b"{}", False))
        assert client.recv(timeout=20) == "{}"
        client.ping().wait(20)
        assert served.ends == []
        if who == "server":
            served.on_loop(reader.end, 1013, "too slow")
            with pytest.raises(ConnectionClosed, match="too slow"):
                client.recv(timeout=20)
    until(lambda: reader.disconnected)
    assert len(served.ends) == 1


def test_one_that_leaves_before_it_is_handed_over_is_told_as_gone(served):
    gone = threading.Event()

    async def late(scope, receive, send):
        await send({"type": "websocket.accept"})
        await asyncio.to_thread(gone.wait, 20)
        scope[READER].hand_over(lambda: served.ends.append(True))

    served.server.config.loaded_app = late
    made = socket.create_connection(served.address)
    if served.context is not None:
        made = served.context.wrap_socket(made, server_hostname="127.0.0.1")
    made.sendall(HANDSHAKE)
    until(lambda: served.server.server_state.tasks)
    made.close()
    until(lambda: not served.server.server_state.connections)
    gone.set()
    until(lambda: served.ends)
    until(lambda: not served.server.server_state.tasks)


@contextlib.contextmanager
def no_garbage_collection():
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def test_nothing_of_a_reader_that_left_waits_for_the_garbage_collection(served):
    served.server.config.loaded_app = served.hand_over
    with no_garbage_collection():
        with contextlib.ExitStack() as clients:
            for _ in range(20):
                clients.enter_context(served.connect())
            until(lambda: len(served.readers) == 20)
            until(lambda: not served.server.server_state.tasks)
            kept = [weakref.ref(part) for each in served.readers for part in (each, each.conn, each.conn.parser)]
            served.readers.clear()
        until(lambda: not served.server.server_state.connections)
        until(lambda: not any(each() for each in kept))
