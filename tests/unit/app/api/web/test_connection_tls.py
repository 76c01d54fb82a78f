"""TLS against a real server: who does not shake hands in time, or not at all, and what is carried when it is done."""

import contextlib
import shutil
import socket
import ssl
import subprocess
import time

import pytest

from app.api.access.certificate import own_certificate
from app.api.web import connection
from app.api.web.connection import HANDSHAKE_S
from tests.service_process import until
from tests.tls_clients import client_hello, trusting_all
from tests.unit.app.api.web.served import Served, rest_of

MOST = 200
REQUEST = b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: %d\r\n\r\n"


@pytest.fixture(scope="module")
def certificate(tmp_path_factory):
    return own_certificate(tmp_path_factory.mktemp("tls"), ["127.0.0.1"], time.time())


@pytest.fixture
def served(certificate):
    one = Served(MOST, certificate)
    yield one
    one.stop()


@pytest.mark.parametrize("share", [0.0, 0.002, 0.5, 1.0], ids=["nothing", "a byte", "half a hello", "a hello"])
def test_who_does_not_end_the_handshake_in_time_is_cut_off_and_freed(served, share):
    hello = client_hello()
    with served.all_freed(), served.open_plain(hello[: int(share * len(hello))]) as made:
        until(lambda: len(served.connections))
        served.skip(HANDSHAKE_S + 1.0)
        rest_of(made)
    assert not len(served.connections)


LARGE = client_hello()[:5] + b"\x01\x01\x00\x00" + bytes(2000)  # a hello that would have 64 KiB


@pytest.mark.parametrize(
    "first",
    [bytes(100), b"\xff" * 100_000, b"GET / HTTP/1.1\r\nHost: x\r\n\r\n", LARGE, client_hello()[:9] + bytes(2000)],
    ids=["zeros", "much of nothing", "plain HTTP", "a hello without end", "a broken hello"],
)
def test_what_is_no_handshake_is_closed_at_once(served, monkeypatch, first):
    monkeypatch.setattr(connection, "HANDSHAKE_S", 3600.0)
    with contextlib.suppress(ConnectionError), served.open_plain(first) as made:
        rest_of(made)
    until(lambda: not len(served.connections))
    assert served.post().content == b"well"


def test_few_handshakes_go_on_at_once_and_they_keep_nobody_out(certificate, monkeypatch):
    monkeypatch.setattr(connection, "MOST_HANDSHAKES", 8)
    monkeypatch.setattr(connection, "HANDSHAKE_S", 3600.0)
    served, hello = Served(MOST, certificate), client_hello()
    with contextlib.ExitStack() as stack:
        stack.callback(served.stop)
        begun = [stack.enter_context(served.open_plain(hello)) for _ in range(40)]
        rest_of(begun[0])  # the one that waited longest made room
        until(lambda: len(served.connections) <= 4)  # half of them, of one address
        assert served.post().content == b"well"


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

    with served.open_plain() as made:
        until_done(made, client.do_handshake)
        client.write(REQUEST % 4 + b"well")
        send(made)
        assert until_done(made, lambda: client.read(1 << 16)).startswith(b"HTTP/1.1 200")


def test_what_is_sent_comes_back_whole_whatever_its_size(served):
    for size in (0, 1, (1 << 14) - 1, (1 << 14) + 1, 5_000_000):
        body = bytes(range(256)) * (size // 256) + bytes(size % 256)
        assert served.post(body).content == body


def test_the_end_of_an_answer_is_the_end_of_tls(served):
    with served.open() as made:
        made.sendall(b"GET / HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n")
        found = b""
        while data := made.recv(1 << 16):  # an end without TLS's own would raise
            found += data
    assert found.startswith(b"HTTP/1.1 200")
    until(lambda: not len(served.connections))


def test_a_client_that_ends_tls_is_answered_alike_and_counts_no_more(served):
    made = served.open()
    until(lambda: len(served.connections) == 1)
    with made.unwrap() as plain:  # waits for the server's own end
        rest_of(plain)
    until(lambda: not len(served.connections))


@pytest.mark.parametrize("rest", [b"", b"no TLS any more" * 100], ids=["an end without TLS's own", "garbage"])
def test_a_broken_connection_counts_no_more(served, rest):
    made = served.open()
    made.sendall(b"GET / HT")
    with socket.socket(fileno=made.detach()) as plain:
        plain.settimeout(20)
        plain.sendall(rest)
        plain.shutdown(socket.SHUT_WR)
        rest_of(plain)
    until(lambda: not len(served.connections))
    assert served.post().content == b"well"


@pytest.mark.skipif(shutil.which("openssl") is None, reason="asks a client that can renegotiate")
def test_a_client_does_not_begin_the_handshake_again(served):
    command = ["openssl", "s_client", "-tls1_2", "-connect", "{}:{}".format(*served.address)]
    done = subprocess.run(command, input="R\n", capture_output=True, text=True, timeout=60, check=False)
    assert "RENEGOTIATING" in done.stdout + done.stderr
    assert "no renegotiation" in done.stderr
