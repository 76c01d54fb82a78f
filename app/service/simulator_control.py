"""Asks the simulator over its control port: one JSON object a line. Knows only bytes, as of any other process."""

import json
import socket
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from app.errors import AppError, LinkError
from app.words import Message

TIMEOUT_S = 3.0
MAX_ANSWER = 1 << 20


class SimulatorRefused(AppError):
    """The simulator understood and did not do it: its own words."""


class SimulatorControl:
    """A connection for each request; `url` is what the simulator printed: unix:PATH, or tcp:PORT token:FILE."""

    def __init__(self) -> None:
        self.url: str | None = None
        self._lock = threading.Lock()

    def ask(self, do: str, arguments: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """Return the answer without its `ok`.

        Raises:
            LinkError: the simulator does not answer.
            SimulatorRefused: it refused.
        """
        given = {name: value for name, value in (arguments or {}).items() if value is not None}
        with self._lock:
            answer = self._exchange({"do": do, **given})
        if not answer.pop("ok", False):
            raise SimulatorRefused(str(answer.get("error", "refused")))
        return answer

    def _exchange(self, request: dict[str, Any]) -> dict[str, Any]:
        if self.url is None:
            raise LinkError(Message("simulator-starting"))
        try:
            with self._connect(request) as connection:
                connection.sendall(json.dumps(request).encode() + b"\n")
                line = b""
                while not line.endswith(b"\n") and len(line) < MAX_ANSWER:
                    part = connection.recv(65536)
                    if not part:
                        break
                    line += part
            answer = json.loads(line)
        except (OSError, ValueError) as error:
            raise LinkError(Message("simulator-silent", error=str(error))) from error
        if not isinstance(answer, dict):
            raise LinkError(Message("simulator-unclear"))
        return answer

    def _connect(self, request: dict[str, Any]) -> socket.socket:
        where, _, token = (self.url or "").partition(" token:")
        kind, _, place = where.partition(":")
        if kind == "unix":
            connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            connection.settimeout(TIMEOUT_S)
            try:
                connection.connect(place)
            except OSError:
                connection.close()
                raise
            return connection
        request["token"] = Path(token).read_text(encoding="utf-8").strip()
        return socket.create_connection(("127.0.0.1", int(place)), TIMEOUT_S)
