"""The live battery: snapshots of a running service, one after the other."""

from __future__ import annotations

import json
import urllib.request
from base64 import b64encode
from collections.abc import AsyncIterator, Iterator
from contextlib import AsyncExitStack, ExitStack
from types import TracebackType
from typing import Any
from urllib.parse import urlsplit

from websockets.asyncio.client import ClientConnection as AsyncConnection
from websockets.asyncio.client import connect as connect_async
from websockets.exceptions import WebSocketException
from websockets.sync.client import ClientConnection as SyncConnection
from websockets.sync.client import connect as connect_sync

from app.errors import ConfigError
from app.sessions.transfer.trust import context_for, opener
from app.words import Message

Snapshot = dict[str, Any]
TIMEOUT_S = 15.0


def connect(
    url: str, *, password: str | None = None, name: str = "", rate: float | None = None, trust: str | None = None
) -> Live:
    """Return the live battery of a running service; nothing is sent yet.

    Args:
        url: of the service, as `http://127.0.0.1:8000`.
        password: its viewer's or engineer's, that of the account `name`, or a token.
        name: who asks.
        rate: snapshots a second at most; None: all.
        trust: the certificate of an https service that the system does not know: a file (PEM) or its SHA-256; without
            it what VOLTWALL_TRUST says.

    Raises:
        VoltwallError: the URL is none of a service, or `trust` none of a certificate.
    """
    return Live(url, password, name, rate, trust)


class Live:
    """Snapshots as dictionaries, as `GET /api/v1/snapshot` describes them: `cells`, `accumulator`, `age` and so on.

    `latest()` asks once. With `with`, or `async with`, the service sends each new snapshot, and `for`, or `async for`,
    takes them; who is slow misses some, and delays nobody. Iteration ends with `ConnectionError` where the service is
    gone.
    """

    def __init__(self, url: str, password: str | None, name: str, rate: float | None, trust: str | None = None) -> None:
        parts = urlsplit(url)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise ConfigError("url", url, Message("url-form"))
        self.url = url.rstrip("/")
        self._headers: dict[str, str] = {}
        if password is not None:
            self._headers["Authorization"] = "Basic " + b64encode(f"{name}:{password}".encode()).decode()
        stream = f"ws{self.url.removeprefix('http')}/api/v1/live"
        self._stream = stream if rate is None else f"{stream}?rate={rate:g}"
        self._options: dict[str, Any] = {"additional_headers": self._headers, "open_timeout": TIMEOUT_S}
        self._options |= {"max_size": None, "proxy": None}
        self._trust = trust
        if parts.scheme == "https":
            self._options["ssl"] = context_for(trust)
        self._opened, self._opened_async = ExitStack(), AsyncExitStack()
        self._sync: SyncConnection | None = None
        self._async: AsyncConnection | None = None

    def __repr__(self) -> str:
        return f"<voltwall.Live {self.url}>"

    def latest(self) -> Snapshot:
        """Return all that is known now.

        Raises:
            OSError: the service does not answer, or refuses.
        """
        request = urllib.request.Request(f"{self.url}/api/v1/snapshot", headers=self._headers)
        with opener(self._trust).open(request, timeout=TIMEOUT_S) as answer:
            snapshot: Snapshot = json.loads(answer.read())
        return snapshot

    def __enter__(self) -> Live:
        try:
            self._sync = self._opened.enter_context(connect_sync(self._stream, **self._options))
        except WebSocketException as error:
            raise ConnectionError(f"{self.url}: {error}") from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._sync = None
        self._opened.close()

    def __iter__(self) -> Iterator[Snapshot]:
        if self._sync is None:
            raise RuntimeError("use `with voltwall.connect(URL) as live`")
        while True:
            try:
                text = self._sync.recv()
            except WebSocketException as error:
                raise ConnectionError(f"{self.url}: {error}") from error
            yield json.loads(text)

    async def __aenter__(self) -> Live:
        try:
            self._async = await self._opened_async.enter_async_context(connect_async(self._stream, **self._options))
        except WebSocketException as error:
            raise ConnectionError(f"{self.url}: {error}") from error
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._async = None
        await self._opened_async.aclose()

    async def __aiter__(self) -> AsyncIterator[Snapshot]:
        if self._async is None:
            raise RuntimeError("use `async with voltwall.connect(URL) as live`")
        while True:
            try:
                text = await self._async.recv()
            except WebSocketException as error:
                raise ConnectionError(f"{self.url}: {error}") from error
            yield json.loads(text)
