"""Many readers of the stream, and some that misbehave: nobody waits for anybody."""

import json
import socket
import threading
import time
from collections import deque
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from tests.service_process import WAIT_S

READS_ONLY = True

READERS = 20
FEWEST = 20  # messages, however slow the machine
MOST_GAP_S = 5.0  # less than it would wait for one that takes nothing


def live_url(service) -> str:
    return service.base_url.replace("http", "ws") + "/api/v1/live"


def stalled(service) -> socket.socket:
    """A reader that shakes hands and then never takes a byte."""
    address = urlsplit(service.base_url)
    made = socket.socket()
    made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    made.connect((address.hostname, address.port))
    made.sendall(
        f"GET /api/v1/live HTTP/1.1\r\nHost: {address.netloc}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
    )
    return made


def resident_bytes(service) -> int:
    pages = Path(f"/proc/{service.process.pid}/statm").read_text().split()[1]
    return int(pages) * 4096


def read(service, seconds: float) -> list[tuple[int, float]]:
    """Return (sequence, seconds since the message before), of this time and not too few."""
    found = []
    with connect(live_url(service), max_size=1 << 22) as live:
        until = last = time.monotonic()
        until += seconds
        while last < until or len(found) <= FEWEST:
            sequence = json.loads(live.recv(timeout=WAIT_S))["seq"]
            now = time.monotonic()
            found.append((sequence, now - last))
            last = now
    return found


def test_readers_that_take_nothing_delay_nobody(service):
    dead = [stalled(service) for _ in range(5)]
    before = resident_bytes(service)
    found: list[list[tuple[int, float]]] = []
    threads = [threading.Thread(target=lambda: found.append(read(service, 4))) for _ in range(READERS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(2 * WAIT_S)
    assert len(found) == READERS
    for messages in found:
        sequences = [sequence for sequence, _ in messages]
        assert sequences == sorted(set(sequences))
        assert max(gap for _, gap in messages[1:]) < MOST_GAP_S
    assert resident_bytes(service) - before < 40 << 20
    for reader in dead:
        reader.close()


def test_a_rate_is_kept(service):
    with connect(live_url(service) + "?rate=2", max_size=1 << 22) as live:
        live.recv(timeout=WAIT_S)
        started = time.monotonic()
        for _ in range(4):
            live.recv(timeout=WAIT_S)
        assert time.monotonic() - started > 1.4


def test_what_a_reader_sends_is_ignored_up_to_a_size(service):
    with connect(live_url(service), max_size=1 << 22) as live:
        live.recv(timeout=WAIT_S)
        live.send("x" * 1000)
        live.send(b"\0" * 1000)
        live.recv(timeout=WAIT_S)
        live.send("x" * (1 << 20))
        with pytest.raises(ConnectionClosed) as closed:
            deque(live, maxlen=0)
    assert closed.value.rcvd.code == 1009
    with service.client() as client:
        assert client.get("/health").status_code == 200
