"""Fuzz target for HTTP: a route, its path, its query and its body, asked of the application without a socket."""

import asyncio
import json
import re
import tempfile
import warnings
from functools import cache
from pathlib import Path
from typing import Any

from app.api.application import create_app
from app.service import wiring
from app.service.settings import Settings
from tests.in_process import InProcess

BREAK = b"\n==\n"  # between place, query and body
PLACES = {"session_id": "20261121T070000Z", "number": "1", "name": "fan-override", "event_id": "1", "cell": "3"}
NO_CAR = {503, 504}  # no link is configured
LEFT_OUT = (
    "/accounts",  # the first chief: from then on everybody has to log in
    "/setup",
    "/imports",
    "/fetch",
    "/season/query",
    "/simulator/balancing",
)  # files have targets of their own; others look for devices, start processes or simulate for minutes
METHODS = ("get", "post", "put", "delete")
KINDS = (b"application/json", b"application/octet-stream", b"application/toml", b"text/plain")


class Application:
    """The application on a data folder of its own, started once."""

    def __init__(self) -> None:
        self._kept = tempfile.TemporaryDirectory(prefix="voltwall-fuzz-")
        wiring.Workers = InProcess  # type: ignore[misc]
        settings = Settings(data=Path(self._kept.name), record=False, season=False)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            self._app = create_app(settings, "serial", serial_url=None, can_url=None)
        self._loop = asyncio.new_event_loop()
        self._life = self._app.router.lifespan_context(self._app)
        self._loop.run_until_complete(self._life.__aenter__())
        document = self._app.openapi()
        self.routes = sorted(
            (method, path)
            for path, methods in document["paths"].items()
            for method in methods
            if method in METHODS and not any(each in path for each in LEFT_OUT)
        )

    def ask(self, method: str, path: str, query: bytes, kind: bytes, body: bytes) -> tuple[int, bytes]:
        """Return the status and the body of the answer."""
        return self._loop.run_until_complete(self._ask(method, path, query, kind, body))

    async def _ask(self, method: str, path: str, query: bytes, kind: bytes, body: bytes) -> tuple[int, bytes]:
        status, told = 0, bytearray()
        asked = asyncio.Event()

        async def receive() -> dict[str, Any]:
            if asked.is_set():
                await asyncio.sleep(3600)
            asked.set()
            return {"type": "http.request", "body": body, "more_body": False}

        async def send(message: dict[str, Any]) -> None:
            nonlocal status
            status = message.get("status", status)
            told.extend(message.get("body", b""))

        headers = [(b"host", b"127.0.0.1"), (b"content-type", kind), (b"if-match", b"*")]
        scope = {
            "type": "http", "asgi": {"version": "3.0"}, "http_version": "1.1", "scheme": "http",
            "method": method.upper(), "path": path, "raw_path": path.encode(), "query_string": query,
            "root_path": "", "headers": headers, "client": ("127.0.0.1", 1), "server": ("127.0.0.1", 80), "state": {},
        }  # fmt: skip
        await asyncio.wait_for(self._app(scope, receive, send), 20)  # type: ignore[arg-type]
        return status, bytes(told)


@cache
def application() -> Application:
    """The one of this process."""
    return Application()


def http(data: bytes) -> None:
    """No body is answered with a 500, and every refusal is a problem document."""
    app = application()
    head, _, rest = data[2:].partition(BREAK)
    query, _, body = rest.partition(BREAK)
    method, path = app.routes[(data[0] if data else 0) % len(app.routes)]
    own = head.decode("utf-8", "replace")
    path = re.sub(r"\{(\w+)\}", lambda found: own or PLACES.get(found[1], "1"), path)
    status, told = app.ask(method, path, query, KINDS[(data[1] if len(data) > 1 else 0) % len(KINDS)], body)
    assert status < 500 or status in NO_CAR, f"{method} {path}: {status} {told[:300]!r}"
    if status >= 400:
        assert json.loads(told)["status"] == status, told[:300]
