"""The port that takes control requests: one JSON object a line, answered with one.

On a Unix socket the file's mode keeps others out; on TCP each request carries the token that stands in the token file.
"""

import contextlib
import hmac
import json
import os
import secrets
import selectors
import socket
import tempfile
from pathlib import Path
from typing import Any

from simulator.control import Control, refusal
from simulator.errors import PortError
from simulator.ports import LOOPBACK

MAX_REQUEST = 4096
MAX_CLIENTS = 4
MAX_PORT = 0xFFFF


class ControlServer:
    """The port: a Unix socket at a path, or TCP on the loopback with a token file."""

    def __init__(self, where: str, control: Control) -> None:
        self._where = where
        self._control = control
        self._is_tcp = where.isdecimal()
        self._token = secrets.token_hex(16) if self._is_tcp else ""
        self._token_file: Path | None = None
        self._listener: socket.socket | None = None
        self._clients: dict[socket.socket, bytearray] = {}
        self._selector: selectors.BaseSelector | None = None

    @property
    def url(self) -> str:
        """Return its address: `unix:PATH`, or `tcp:PORT token:FILE`."""
        if self._listener is None or not self._is_tcp:
            return f"unix:{self._where}"
        return f"tcp:{self._listener.getsockname()[1]} token:{self._token_file}"

    def open(self, selector: selectors.BaseSelector) -> None:
        """Listen.

        Raises:
            PortError: the port is taken, or the path cannot be used.
        """
        if self._is_tcp and (len(self._where) > 5 or int(self._where) > MAX_PORT):
            raise PortError(f"control {self._where}", f"a port is 0..{MAX_PORT}")
        try:
            self._listener = self._listen()
        except (OSError, ValueError, AttributeError) as error:
            raise PortError(f"control {self._where}", str(error)) from error
        self._listener.setblocking(False)
        self._selector = selector
        selector.register(self._listener, selectors.EVENT_READ, self._accept)

    def _listen(self) -> socket.socket:
        if self._is_tcp:
            listener = socket.create_server((LOOPBACK, int(self._where)))
            descriptor, name = tempfile.mkstemp(
                prefix="voltwall-control-", suffix=".token"
            )  # readable by its owner only
            with os.fdopen(descriptor, "w", encoding="ascii") as file:
                file.write(self._token)
            self._token_file = Path(name)
            return listener
        path = Path(self._where)
        if path.is_socket():
            path.unlink()
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        previous = os.umask(0o177)
        try:
            listener.bind(str(path))
        finally:
            os.umask(previous)
        listener.listen()
        return listener

    def _accept(self) -> None:
        if self._listener is None or self._selector is None:
            return
        with contextlib.suppress(OSError):
            client, _ = self._listener.accept()
            if len(self._clients) >= MAX_CLIENTS:
                client.close()
                return
            client.setblocking(False)
            self._clients[client] = bytearray()
            self._selector.register(client, selectors.EVENT_READ, lambda: self._read(client))

    def _read(self, client: socket.socket) -> None:
        if client not in self._clients:
            return
        try:
            data = client.recv(MAX_REQUEST)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        buffer = self._clients[client]
        buffer += data
        if not data or len(buffer) > MAX_REQUEST:
            self._drop(client)
            return
        while (end := buffer.find(b"\n")) >= 0:
            line = bytes(buffer[:end])
            del buffer[: end + 1]
            try:
                client.send(json.dumps(self._answer(line), allow_nan=False).encode() + b"\n")
            except OSError:
                self._drop(client)
                return

    def _answer(self, line: bytes) -> dict[str, Any]:
        try:
            request = json.loads(line)
        except (ValueError, RecursionError):
            return refusal("a line is one JSON object")
        if not isinstance(request, dict):
            return refusal("a line is one JSON object")
        given = str(request.pop("token", None)).encode("utf-8", "backslashreplace")
        if self._is_tcp and not hmac.compare_digest(given, self._token.encode()):
            return refusal("the token of the token file is missing")
        return self._control.answer(request)

    def _drop(self, client: socket.socket) -> None:
        if self._clients.pop(client, None) is not None and self._selector is not None:
            self._selector.unregister(client)
            client.close()

    def close(self) -> None:
        """Close everything and remove the socket or the token file."""
        if self._listener is None or self._selector is None:
            return
        for client in list(self._clients):
            self._drop(client)
        self._selector.unregister(self._listener)
        self._listener.close()
        self._listener = None
        file = self._token_file if self._is_tcp else Path(self._where)
        if file is not None:
            file.unlink(missing_ok=True)
