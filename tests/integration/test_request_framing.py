"""Requests whose end can be understood in two ways, on a raw socket: refused, and nothing of what follows is read."""

import contextlib
import socket

import pytest

from tests.service_process import NO_CAR, Service

HEAD = b"POST /api/v1/login HTTP/1.1\r\nHost: 127.0.0.1\r\n"
NEXT = b"GET /api/v1/health HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
CHUNKED, END = b"Transfer-Encoding: chunked\r\n", b"\r\n0\r\n\r\n"


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    service = Service(tmp_path_factory.mktemp("service"), ["--serial", NO_CAR]).start()
    host, port = service.base_url.removeprefix("http://").split(":")
    yield host, int(port)
    service.stop()


def answers(address, request):
    """All that comes until the service closes."""
    with socket.create_connection(address, timeout=20) as made, contextlib.suppress(ConnectionError):
        made.sendall(request)
        found = b""
        while part := made.recv(65536):
            found += part
    return found


@pytest.mark.parametrize(
    "request_bytes",
    [
        HEAD + b"Content-Length: 3\r\n" + CHUNKED + END,
        HEAD + CHUNKED + b"Content-Length: 5\r\n" + END,
        HEAD + b"Transfer-Encoding:\r\n chunked\r\nContent-Length: 5\r\n" + END,
        HEAD.replace(b"1.1", b"1.0") + CHUNKED + END,
        HEAD + b"Content-Length: 3\r\nContent-Length: 4\r\n\r\nabcd",
        HEAD + b"Content-Length: 3, 4\r\n\r\nabcd",
        HEAD + b"Content-Length: +3\r\n\r\nabc",
        HEAD + b"Transfer-Encoding: gzip, chunked\r\n" + END,
        HEAD + CHUNKED + CHUNKED + END,
        HEAD + b"Transfer-Encoding : chunked\r\n" + END,
    ],
    ids=[
        "length, coding", "coding, length", "folded coding, length", "coding in HTTP/1.0", "two lengths",
        "list of lengths", "signed length", "another coding", "coding twice", "blank before the colon",
    ],
)  # fmt: skip
def test_a_request_with_two_ends_is_refused_and_the_connection_closed(address, request_bytes):
    found = answers(address, request_bytes + NEXT)
    assert found.startswith(b"HTTP/1.1 400 ")
    assert found.count(b"HTTP/1.1 ") == 1, "what follows is no request"


@pytest.mark.parametrize(
    "first",
    [
        HEAD + b"Content-Length: 2\r\n\r\n{}",
        HEAD + b"Content-Length: 2\r\nContent-Length: 2\r\n\r\n{}",
        HEAD + b"X-Note: a\r\n b\r\nContent-Length: 2\r\n\r\n{}",
        HEAD.replace(b"\r", b"") + b"Content-Length: 2\n\n{}",
        HEAD + CHUNKED + b"\r\n2\r\n{}\r\n0\r\n\r\n",
    ],
    ids=["length", "the same length twice", "folded line", "bare LF", "chunked"],
)
def test_one_end_is_understood_and_the_next_request_read(address, first):
    last = NEXT.replace(b"\r\n\r\n", b"\r\nConnection: close\r\n\r\n")
    found = answers(address, first + last)
    assert found.count(b"HTTP/1.1 ") == 2
    assert b"HTTP/1.1 200 " in found
