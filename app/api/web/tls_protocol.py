"""TLS before HTTP: a connection counts from the moment it is accepted, and costs little until its handshake is done.

No TLS is set up before the client's first message has begun; those whose handshake goes on then have a limit of their
own, because each of them costs ten times as much as a silent one.
"""

import asyncio
import ssl
from collections.abc import Callable
from typing import Any, cast

import uvicorn
from uvicorn.protocols.utils import get_remote_addr
from uvicorn.server import ServerState

from app.api.web.connection_limits import ClientConnections, refuse
from app.api.web.http_protocol import HttpProtocol
from app.api.web.tls_transport import TlsTransport

HANDSHAKE_S = 5.0  # from the connection to the end of the handshake
LATE_S = 0.1  # a timer; from then on that is time of the service, not of the client
MOST_HANDSHAKES = 256  # at once; half of them from one address
HELLO_BYTES = 1 << 14  # OpenSSL accepts 128 KiB, and sets aside what the header names
_HEADER_BYTES = 9  # of a record, then of its first message: type, version, length; type, length
_HANDSHAKE, _CLIENT_HELLO = 22, 1


class TlsProtocol(asyncio.Protocol):
    """Counts a connection, shakes hands, then passes on between the network and HttpProtocol."""

    is_websocket = False

    def __init__(
        self,
        context: ssl.SSLContext,
        handshakes: ClientConnections,
        config: uvicorn.Config,
        server_state: ServerState,
        app_state: dict[str, Any],
    ) -> None:
        self._context = context
        self._handshakes = handshakes
        self._config = config
        self._state = server_state
        self._app_state = app_state
        self._first = b""
        self._above: TlsTransport | None = None
        self._timer: asyncio.TimerHandle | None = None
        self.client: tuple[str, int] | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Count it, or close it."""
        self._network = transport
        self.client = get_remote_addr(transport)
        if not self._connections.make_room(self._address, self._config.limit_concurrency or 1 << 30):
            refuse(self._address, "a connection")
            transport.abort()
            return
        self._connections.add(self)
        self._connections.start_waiting(self)
        self._set_deadline(HANDSHAKE_S)

    def data_received(self, data: bytes) -> None:
        """Set up TLS for a client that begins it, and pass on what it sends."""
        if self._above is None:
            self._first += data
            if len(self._first) < _HEADER_BYTES:
                return
            if not _is_hello(self._first) or not self._handshakes.make_room(self._address, MOST_HANDSHAKES):
                self.cut()
                return
            self._handshakes.add(self)
            self._handshakes.start_waiting(self)
            self._above = TlsTransport(self._network, self._context)
            data, self._first = self._first, b""
        try:
            plain = self._above.decrypt(data)
        except ssl.SSLError:
            self._network.close()
            return
        if self._timer is not None and self._above.is_secured:
            self._hand_over(self._above)
        self._pass_on(self._above, plain)

    def eof_received(self) -> None:
        """Pass it on; the connection is closed."""
        if self._protocol is not None:
            self._protocol.eof_received()

    def pause_writing(self) -> None:
        """Pass it on."""
        if self._protocol is not None:
            self._protocol.pause_writing()

    def resume_writing(self) -> None:
        """Pass it on."""
        if self._protocol is not None:
            self._protocol.resume_writing()

    def connection_lost(self, exc: Exception | None) -> None:
        """The end, of the protocol above too."""
        self._forget()
        if self._above is not None and self._protocol is not None:
            self._protocol.connection_lost(exc)
            self._above.set_protocol(None)  # it refers to the transport

    def cut(self) -> None:
        """End it at once; before the end of the handshake."""
        self._forget()
        self._network.abort()

    def shutdown(self) -> None:
        """The service ends."""
        self.cut()

    @property
    def _connections(self) -> ClientConnections:
        return cast(ClientConnections, self._state.connections)

    @property
    def _address(self) -> str:
        return "" if self.client is None else self.client[0]

    @property
    def _protocol(self) -> asyncio.Protocol | None:
        return None if self._above is None else cast(asyncio.Protocol | None, self._above.get_protocol())

    def _hand_over(self, above: TlsTransport) -> None:
        self._forget()
        protocol = HttpProtocol(self._config, self._state, self._app_state)
        above.set_protocol(protocol)
        protocol.connection_made(above)

    def _pass_on(self, above: TlsTransport, plain: bytes) -> None:
        if plain and self._protocol is not None and not above.is_closing():
            self._protocol.data_received(plain)
        if above.has_ended and not above.is_closing():
            self.eof_received()
            above.close()

    def _set_deadline(self, seconds: float) -> None:
        loop = asyncio.get_running_loop()
        due_s = loop.time() + seconds
        self._timer = loop.call_later(seconds, self._end_late, due_s)

    def _end_late(self, due_s: float) -> None:
        late_s = asyncio.get_running_loop().time() - due_s
        if late_s > LATE_S:
            self._set_deadline(late_s)  # what the client sent meanwhile has not been read
        else:
            self.cut()

    def _forget(self) -> None:
        """Count it here no more."""
        self._connections.discard(self)
        self._handshakes.discard(self)
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None


def _is_hello(first: bytes) -> bool:
    """Return whether a client's first bytes begin a ClientHello of usual size (RFC 8446, 5.1 and 4)."""
    return first[0] == _HANDSHAKE and first[5] == _CLIENT_HELLO and int.from_bytes(first[6:9], "big") <= HELLO_BYTES


def tls_protocol(context: ssl.SSLContext) -> Callable[..., TlsProtocol]:
    """Return what makes the protocol of a connection, in the way uvicorn asks for it."""
    handshakes = ClientConnections()

    def make(
        config: uvicorn.Config, server_state: ServerState, app_state: dict[str, Any], _loop: object = None
    ) -> TlsProtocol:
        return TlsProtocol(context, handshakes, config, server_state, app_state)

    return make
