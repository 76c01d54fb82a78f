"""Whose delay a limit counts: the client's, never the service's own. On a loop whose clock the test turns."""

import asyncio
import contextlib
import socket
import ssl
import sys
from functools import partial

import pytest
import uvicorn
from uvicorn.server import ServerState

from app.api.web.connection_limits import ClientConnections
from app.api.web.http_protocol import ANSWER_BYTES, ANSWER_S, BODY_BYTES, BODY_S, REQUEST_S, HttpProtocol
from app.api.web.tls_transport import TlsTransport

HIGH_WATER = 65_536  # uvicorn reads no further while more than that waits for the application
EARLY_S = 0.5  # before a limit is reached
STEP_S = 0.25


class Loop(asyncio.SelectorEventLoop):
    def __init__(self):
        self.now_s = 100.0
        super().__init__()

    def time(self):
        return self.now_s

    def turn(self, seconds):
        """Let time pass, and whoever is due do its work."""
        until_s = self.now_s + seconds
        while self.now_s < until_s:
            self.now_s = min(self.now_s + STEP_S, until_s)
            self.settle()

    def settle(self):
        for _ in range(5):
            self.run_until_complete(asyncio.sleep(0))


class Transport:
    def __init__(self):
        self.unsent, self.said, self.is_open, self.is_read, self.protocol = 0, b"", True, True, None
        self.known = {"peername": ("10.0.0.2", 4711), "sockname": ("10.0.0.2", 4711)}

    def get_extra_info(self, name, default=None):
        return self.known.get(name, default)

    def set_write_buffer_limits(self, high):
        assert high == 0  # told of all that waits

    def get_protocol(self):
        return self.protocol

    def get_write_buffer_size(self):
        return self.unsent

    def pause_reading(self):
        self.is_read = False

    def resume_reading(self):
        self.is_read = True

    def write(self, data):
        self.said += data

    def is_closing(self):
        return not self.is_open

    def close(self):
        self.is_open = False

    abort = close


class Wire:
    """A client's end of a connection, and the application that takes its request when it is told to."""

    def __init__(self):
        self.loop, self.transport = Loop(), Transport()
        config = uvicorn.Config(self.app, interface="asgi3", lifespan="off", log_config=None)
        config.load()
        state = ServerState()
        state.connections = ClientConnections()
        self.protocol = HttpProtocol(config, state, {}, _loop=self.loop)
        self.transport.protocol = self.protocol
        self.may_take, self.taken = asyncio.Event(), 0
        self.protocol.connection_made(self.transport)

    async def app(self, scope, receive, send):
        await self.may_take.wait()
        more = True
        while more:
            message = await receive()
            self.taken += len(message.get("body", b""))
            more = message.get("more_body", False)
        await send({"type": "http.response.start", "status": 204, "headers": []})
        await send({"type": "http.response.body"})

    def say(self, *lines, body=b""):
        self.protocol.data_received("\r\n".join([*lines, "", ""]).encode() if lines else body)
        self.loop.settle()

    def application_takes(self):
        self.may_take.set()
        self.loop.settle()

    @property
    def is_open(self):
        return self.transport.is_open


@pytest.fixture
def wire():
    one = Wire()
    yield one
    one.protocol.connection_lost(None)
    one.application_takes()
    one.loop.close()


GET = ("GET / HTTP/1.1", "Host: x")
POST = ("POST / HTTP/1.1", "Host: x", "Content-Length: 200000")


def test_a_body_is_not_judged_while_nobody_here_takes_it(wire):
    wire.say(*POST)
    wire.say(body=bytes(HIGH_WATER + 1))
    assert not wire.transport.is_read
    wire.loop.turn(3 * BODY_S - EARLY_S)
    wire.application_takes()  # just before the next look
    assert wire.transport.is_read
    assert wire.taken
    wire.loop.turn(2 * EARLY_S)
    assert wire.is_open
    wire.loop.turn(2 * BODY_S)  # from now on it is the client that says nothing
    assert not wire.is_open


def test_a_body_is_not_judged_before_its_client_was_told_to_go_on(wire):
    wire.say(*POST, "Expect: 100-continue")
    wire.loop.turn(3 * BODY_S - EARLY_S)
    assert wire.is_open
    wire.application_takes()
    assert wire.transport.said.startswith(b"HTTP/1.1 100 ")
    wire.loop.turn(2 * EARLY_S)
    assert wire.is_open
    wire.loop.turn(2 * BODY_S)
    assert not wire.is_open


def test_a_body_that_comes_too_slowly_is_cut_off_however_fast_it_is_taken(wire):
    wire.say(*POST)
    for _ in range(10):
        wire.say(body=bytes(BODY_BYTES // 20))
        wire.application_takes()
        wire.loop.turn(BODY_S / 10)
    assert not wire.is_open


def test_the_next_request_has_as_long_as_the_first(wire):
    """At five seconds the server's own limit met the clients' that keep a connection for as long."""
    wire.say(*GET)
    wire.application_takes()
    assert wire.transport.said.startswith(b"HTTP/1.1 204")
    wire.loop.turn(REQUEST_S - EARLY_S)
    assert wire.is_open
    wire.loop.turn(2 * EARLY_S)
    assert not wire.is_open


def test_what_came_while_the_loop_was_busy_is_read_before_a_connection_is_closed(wire):
    request = "\r\n".join([*GET, "", ""]).encode()
    comes = partial(wire.loop.call_soon, wire.protocol.data_received, request)  # with the next look at the sockets
    wire.loop.call_later(REQUEST_S + 1.0, comes)
    wire.loop.now_s += REQUEST_S + 2.0
    wire.loop.settle()
    wire.application_takes()
    assert wire.is_open
    assert wire.transport.said.startswith(b"HTTP/1.1 204")


@pytest.fixture
def system(wire):
    """The system's end of the connection, and the client's: on Linux it tells what waits in it."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        client = socket.create_connection(listener.getsockname())
        made, _ = listener.accept()
    made.setblocking(False)
    with made, client:
        wire.transport.known["socket"] = made
        yield made, client


@pytest.mark.parametrize("is_secured", [False, True], ids=["plain", "below TLS"])
def test_an_answer_is_not_cut_off_while_enough_of_it_is_taken(wire, is_secured):
    network = wire.transport
    if is_secured:
        wire.protocol.transport = TlsTransport(network, ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER))
        wire.protocol.transport.set_protocol(wire.protocol)
    wire.say(*GET)
    network.unsent = 10_000_000
    wire.protocol.pause_writing()
    for _ in range(20):
        wire.loop.turn(ANSWER_S - 1.0)
        network.unsent -= 400_000
        assert wire.is_open
    wire.loop.turn(2 * ANSWER_S)  # nothing is taken any more
    assert not wire.is_open


@pytest.mark.skipif(sys.platform != "linux", reason="asks Linux what a client has not taken")
def test_an_answer_that_is_taken_too_slowly_is_cut_off(wire, system):
    wire.say(*GET)
    wire.transport.unsent = 10_000_000
    wire.protocol.pause_writing()
    wire.loop.turn(ANSWER_S - EARLY_S)
    wire.transport.unsent -= ANSWER_BYTES - 1
    wire.loop.turn(2 * EARLY_S)
    assert not wire.is_open


@pytest.mark.skipif(sys.platform != "linux", reason="asks Linux what a client has not taken")
def test_an_answer_in_small_pieces_that_are_taken_too_slowly_is_cut_off(wire, system):
    wire.say(*GET)
    for _ in range(4):
        wire.transport.unsent = ANSWER_BYTES // 4
        wire.protocol.pause_writing()
        wire.loop.turn(ANSWER_S / 3)
        wire.transport.unsent = 0
        wire.protocol.resume_writing()  # the whole piece is taken, and the next is made: that is no time of the client
        wire.loop.turn(10 * ANSWER_S if wire.is_open else 0.0)
    assert not wire.is_open


@pytest.mark.skipif(sys.platform != "linux", reason="asks Linux what a client has not taken")
def test_an_answer_that_leaves_the_system_is_not_cut_off_although_the_system_takes_no_more_of_it(wire, system):
    """The system takes more only when a third of its megabytes is free: at 1 kB/s for many minutes nothing."""
    made, client = system
    with contextlib.suppress(BlockingIOError):
        while True:
            made.send(bytes(1 << 16))
    wire.say(*GET)
    wire.transport.unsent = 1_000_000
    wire.protocol.pause_writing()
    for _ in range(10):
        waits = wire.protocol._unsent_bytes()
        while waits - wire.protocol._unsent_bytes() < ANSWER_BYTES:
            client.recv(1 << 16)
        wire.loop.turn(ANSWER_S - EARLY_S)
        assert wire.is_open
    wire.loop.turn(2 * ANSWER_S)
    assert not wire.is_open


def test_the_last_bytes_before_a_connection_is_closed_have_no_more_time(wire):
    wire.say(*GET)
    wire.transport.unsent = 100
    wire.protocol.pause_writing()
    wire.application_takes()
    closed_s = wire.loop.now_s
    cut = []
    wire.transport.close = lambda: None
    wire.transport.abort = lambda: cut.append(wire.loop.now_s)
    wire.loop.turn(2 * ANSWER_S)
    assert cut[0] - closed_s <= ANSWER_S
