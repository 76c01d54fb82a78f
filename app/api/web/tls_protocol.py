"""TLS before HTTP: who does not end the handshake in time is cut off, and counts as a connection from its first byte.

The event loop's own way tells nobody of a connection before its handshake is done: a thousand silent ones would take
every descriptor.
"""

import asyncio
import ssl
from collections.abc import Callable
from typing import Any

from uvicorn.protocols.utils import get_remote_addr

from app.api.web.connection_limits import make_room, refuse
from app.api.web.http_protocol import HttpProtocol

HANDSHAKE_S = 20.0  # two answers each way, also where each side is seconds late


class TlsProtocol(asyncio.Protocol):
    """A connection until its handshake is done; then HttpProtocol takes it."""

    is_websocket = False

    def __init__(self, context: ssl.SSLContext, options: dict[str, Any]) -> None:
        self._context = context
        self._options = options
        self._connections = options["server_state"].connections
        self._early = bytearray()
        self._task: asyncio.Task[None] | None = None
        self.client: tuple[str, int] | None = None
        self.waits_since_s: float | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Count it, and shake hands."""
        self._transport = transport
        self.client = get_remote_addr(transport)
        address = "" if self.client is None else self.client[0]
        if not make_room(self._connections, address, self._options["config"].limit_concurrency or 1 << 30):
            refuse(address, "a connection")
            transport.abort()
            return
        transport.pause_reading()  # what comes is the handshake's
        loop = asyncio.get_running_loop()
        self.waits_since_s = loop.time()
        self._connections.add(self)
        self._task = loop.create_task(self._shake_hands(transport, loop))

    async def _shake_hands(self, transport: asyncio.Transport, loop: asyncio.AbstractEventLoop) -> None:
        try:
            secured = await loop.start_tls(
                transport, self, self._context, server_side=True, ssl_handshake_timeout=HANDSHAKE_S
            )
        except OSError:  # no TLS, or gone
            return
        finally:
            self._connections.discard(self)
        if secured is None or secured.is_closing():
            return
        transport.set_write_buffer_limits(high=0)  # what waits for the network waits in the TLS layer, which tells it
        protocol = HttpProtocol(**self._options)
        protocol.wire = transport
        secured.set_protocol(protocol)
        protocol.connection_made(secured)
        if self._early and not secured.is_closing():
            protocol.data_received(bytes(self._early))

    def data_received(self, data: bytes) -> None:
        """Keep what came with the end of the handshake."""
        self._early += data

    def connection_lost(self, exc: Exception | None) -> None:
        """It is gone before it began."""
        self._connections.discard(self)

    def cut(self) -> None:
        """End it at once."""
        self._connections.discard(self)
        self._transport.abort()

    def shutdown(self) -> None:
        """The service ends."""
        self.cut()


def tls_protocol(context: ssl.SSLContext) -> Callable[..., TlsProtocol]:
    """Return what makes the protocol of a connection, as uvicorn asks for it."""
    return lambda **options: TlsProtocol(context, options)
