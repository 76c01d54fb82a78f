"""TLS against a real server: who does not shake hands in time, or not at all, and what is carried when it is done."""

import asyncio
import contextlib
import shutil
import socket
import ssl
import subprocess
import threading
import time

import httpx
import pytest
import uvicorn

from app.api.access.certificate import own_certificate
from app.api.web import tls_protocol as tls
from app.api.web.connection_limits import ClientConnections
from app.commands.console.tls import context_of
from tests.service_process import until
from tests.tls_clients import client_hello, trusting_all

MOST = 200
REQUEST = b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: %d\r\n\r\n"


async def echo(scope, receive, send):
    if scope["type"] == "lifespan":
        return
    body = bytearray()
    while (message := await receive())["type"] == "http.request":
        body += message.get("body", b"")
        if not message.get("more_body"):
            break
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": bytes(body)})


class Served:
    def __init__(self, certificate):
        http = tls.tls_protocol(context_of(certificate))
        config = uvicorn.Config(echo, http=http, limit_concurrency=MOST, lifespan="off", log_config=None)
        self.server = uvicorn.Server(config)
        self.connections = self.server.server_state.connections = ClientConnections()
        listener = socket.create_server(("127.0.0.1", 0))
        self.address = listener.getsockname()
        self.thread = threading.Thread(target=lambda: asyncio.run(self.server._serve([listener])))
        self.thread.start()
        until(lambda: self.server.started)

    def open(self, first=b""):
        made = socket.create_connection(self.address, timeout=20)
        made.sendall(first)
        return made

    def post(self, body):
        return httpx.post("https://{}:{}/".format(*self.address), content=body, verify=False, timeout=20).content


@pytest.fixture(scope="module")
def certificate(tmp_path_factory):
    return own_certificate(tmp_path_factory.mktemp("tls"), ["127.0.0.1"], time.time())


@pytest.fixture
def served(certificate):
    one = Served(certificate)
    yield one
    one.server.should_exit = True
    one.thread.join()


def is_closed(connection):
    """Wait until the other side has closed."""
    with connection, contextlib.suppress(ConnectionError):
        while connection.recv(4096):
            pass
    return True


@pytest.mark.parametrize("share", [0.0, 0.002, 0.5, 1.0], ids=["nothing", "a byte", "half a hello", "a hello"])
def test_who_does_not_end_the_handshake_in_time_is_cut_off(served, monkeypatch, share):
    monkeypatch.setattr(tls, "HANDSHAKE_S", 0.3)
    hello = client_hello()
    assert is_closed(served.open(hello[: int(share * len(hello))]))
    until(lambda: not served.connections)


LARGE = client_hello()[:5] + b"\x01\x01\x00\x00" + bytes(2000)  # a hello that would have 64 KiB


@pytest.mark.parametrize(
    "first",
    [bytes(100), b"\xff" * 100_000, b"GET / HTTP/1.1\r\nHost: x\r\n\r\n", LARGE, client_hello()[:9] + bytes(2000)],
    ids=["zeros", "much of nothing", "plain HTTP", "a hello without end", "a broken hello"],
)
def test_what_is_no_handshake_is_closed_at_once(served, monkeypatch, first):
    monkeypatch.setattr(tls, "HANDSHAKE_S", 3600.0)
    assert is_closed(served.open(first))
    until(lambda: not served.connections)
    assert served.post(b"well") == b"well"


def test_few_handshakes_go_on_at_once_and_they_keep_nobody_out(served, monkeypatch):
    monkeypatch.setattr(tls, "MOST_HANDSHAKES", 8)
    monkeypatch.setattr(tls, "HANDSHAKE_S", 3600.0)
    hello = client_hello()
    with contextlib.ExitStack() as stack:
        begun = [stack.enter_context(served.open(hello)) for _ in range(40)]
        until(lambda: len(served.connections) <= 4)  # half of them, of one address
        assert served.post(b"well") == b"well"
        assert is_closed(begun[0])  # the one that waited longest made room


def test_silent_connections_keep_nobody_out(served):
    silent = [served.open() for _ in range(2 * MOST)]
    assert served.post(b"well") == b"well"
    assert len(served.connections) <= MOST // 2
    for each in silent:
        each.close()
    until(lambda: not served.connections)


@pytest.mark.parametrize("version", [ssl.TLSVersion.TLSv1_2, ssl.TLSVersion.TLSv1_3])
def test_a_handshake_that_comes_in_single_bytes_is_one(served, version):
    context = trusting_all()
    context.minimum_version = context.maximum_version = version
    incoming, outgoing = ssl.MemoryBIO(), ssl.MemoryBIO()
    client = context.wrap_bio(incoming, outgoing)

    def until_done(made, step):
        while True:
            try:
                return step()
            except ssl.SSLWantReadError:
                send(made)
                incoming.write(made.recv(1 << 16))

    def send(made):
        for byte in outgoing.read():
            made.sendall(bytes([byte]))

    with served.open() as made:
        made.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        until_done(made, client.do_handshake)
        client.write(REQUEST % 4 + b"well")
        send(made)
        assert until_done(made, lambda: client.read(1 << 16)).startswith(b"HTTP/1.1 200")


def test_what_is_sent_comes_back_whole_whatever_its_size(served):
    for size in (0, 1, (1 << 14) - 1, (1 << 14) + 1, 5_000_000):
        body = bytes(range(256)) * (size // 256) + bytes(size % 256)
        assert served.post(body) == body


def secured(served):
    return trusting_all().wrap_socket(served.open(), suppress_ragged_eofs=False)


def test_the_end_of_an_answer_is_the_end_of_tls(served):
    with secured(served) as made:
        made.sendall(b"GET / HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n")
        found = b""
        while data := made.recv(1 << 16):  # an end without TLS's own would raise
            found += data
    assert found.startswith(b"HTTP/1.1 200")
    until(lambda: not served.connections)


def test_a_client_that_ends_tls_is_answered_alike_and_counts_no_more(served):
    made = secured(served)
    until(lambda: len(served.connections) == 1)
    with made.unwrap() as plain:  # waits for the server's own end
        assert is_closed(plain)
    until(lambda: not served.connections)


@pytest.mark.parametrize("rest", [b"", b"no TLS any more" * 100], ids=["an end without TLS's own", "garbage"])
def test_a_broken_connection_counts_no_more(served, rest):
    made = secured(served)
    made.sendall(b"GET / HT")
    with socket.socket(fileno=made.detach()) as plain:
        plain.settimeout(20)
        plain.sendall(rest)
        plain.shutdown(socket.SHUT_WR)
        assert is_closed(plain)
    until(lambda: not served.connections)
    assert served.post(b"well") == b"well"


def test_time_in_which_the_service_stands_still_is_not_the_clients(served, monkeypatch):
    monkeypatch.setattr(tls, "HANDSHAKE_S", 0.5)
    loop = served.server.servers[0].get_loop()
    with served.open() as made:
        until(lambda: served.connections)
        stands, goes_on = threading.Event(), threading.Event()

        def stand_still():
            stands.set()
            goes_on.wait(20)

        loop.call_soon_threadsafe(stand_still)
        stands.wait(20)
        begin = threading.Timer(1.0, goes_on.set)  # past the deadline, which is not judged meanwhile
        begin.start()
        with trusting_all().wrap_socket(made) as secured_one:
            assert goes_on.is_set()
            secured_one.sendall(b"GET / HTTP/1.1\r\nHost: x\r\n\r\n")
            assert secured_one.recv(4096).startswith(b"HTTP/1.1 200")


@pytest.mark.skipif(shutil.which("openssl") is None, reason="asks a client that can renegotiate")
def test_a_client_does_not_begin_the_handshake_again(served):
    command = ["openssl", "s_client", "-tls1_2", "-connect", "{}:{}".format(*served.address)]
    done = subprocess.run(command, input="R\n", capture_output=True, text=True, timeout=60, check=False)
    assert "RENEGOTIATING" in done.stdout + done.stderr
    assert "no renegotiation" in done.stderr
