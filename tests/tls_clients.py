"""Clients of TLS as tests need them: the first message of one, and one that asks for no proof."""

import contextlib
import resource
import socket
import ssl
import sys


def trusting_all() -> ssl.SSLContext:
    """A client that takes any certificate."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    return context


def client_hello() -> bytes:
    """The first bytes of a handshake: one record."""
    outgoing = ssl.MemoryBIO()
    try:
        trusting_all().wrap_bio(ssl.MemoryBIO(), outgoing).do_handshake()
    except ssl.SSLWantReadError:
        return outgoing.read()
    raise AssertionError


def main() -> None:
    """Open connections, say how many, hold them until standard input ends: HOST PORT COUNT ADDRESSES FIRST_BYTES.

    They come from 127.0.0.2 and up; the first bytes of each are hexadecimal.
    """
    host, port, count, addresses, first = sys.argv[1], *map(int, sys.argv[2:5]), bytes.fromhex(sys.argv[5])
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
    held = []
    for number in range(count):
        held.append(socket.create_connection((host, port), 30, (f"127.0.0.{2 + number % addresses}", 0)))
        with contextlib.suppress(ConnectionError):  # it made room already
            held[-1].sendall(first)
    print(len(held), flush=True)
    sys.stdin.read()


if __name__ == "__main__":
    main()
