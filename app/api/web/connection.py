"""A connection between the network and uvicorn's own protocols: TLS, and limits on how many there are and how slow.

Only what asyncio and ASGI define is used: uvicorn's protocols get a transport and bytes, and a middleware says when a
request begins, waits for its body and is answered.

A limit counts what the client is late, never what the service is: a body is judged only while the application waits
for it, an answer only while some of it waits for the client, and a timer that comes late gives that time once more.
Nothing is made for a client that has sent nothing: no HTTP before its first byte, no TLS before its first message has
begun; handshakes that go on have a limit of their own, because each costs ten times as much as a silent connection.
"""

import asyncio
import contextlib
import socket
import ssl
from collections.abc import Callable
from functools import partial
from typing import Any, cast

import uvicorn
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.server import ServerState

from app.api.web.connection_limits import ClientConnections
from app.api.web.transport import TlsTransport, UpperTransport

HANDSHAKE_S = 5.0  # time limit of the TLS handshake
REQUEST_S = 20.0  # from the connection, or the answer before, to the last byte of a request's headers
BODY_S = 10.0  # time in which BODY_BYTES of a body have to come
BODY_BYTES = 5_000
ANSWER_S = 60.0  # in which some of what waits for the client has to be taken: the system takes UNSENT_BYTES / 2 at once
UNSENT_BYTES = 1 << 16  # in the system, of one connection: what waits there is old when it arrives
SENT_S = 10.0  # in which the client of a websocket may send SENT_BYTES
SENT_BYTES = 1 << 18
LATE_S = 0.1  # a timer; from then on that is time of the service, not of the client
MOST_HANDSHAKES = 256  # at once; half of them from one address
HELLO_BYTES = 1 << 14  # OpenSSL accepts 128 KiB, and sets aside what the header names
CONNECTION = "connection"  # in the state of a scope
_HEADER_BYTES = 9  # header of a TLS record and of its first message: type, version, length; type, length
_HANDSHAKE, _CLIENT_HELLO = 22, 1
_LATE = b"HTTP/1.1 408 Request Timeout\r\nconnection: close\r\nretry-after: 5\r\ncontent-length: 0\r\n\r\n"


def server_config(
    app: ASGIApp, connections: ClientConnections, context: ssl.SSLContext | None = None, **options: Any
) -> uvicorn.Config:
    """Return uvicorn's configuration for an application behind these limits; with `context` by HTTPS."""
    return uvicorn.Config(
        RequestLimits(app),
        http=partial(Connection, connections, ClientConnections(MOST_HANDSHAKES), context),  # type: ignore[arg-type]
        ws="websockets-sansio",
        ws_max_size=1 << 16,
        ws_per_message_deflate=False,  # its work for each reader would be most of the service's
        timeout_keep_alive=round(2 * REQUEST_S),  # REQUEST_S comes first
        proxy_headers=False,  # who counts wrong passwords by address must not trust a header
        server_header=False,
        access_log=False,
        log_config=None,
        **options,
    )


class Connection(asyncio.Protocol):
    """Counts, decrypts, passes on; cuts off a client that is silent, too slow, or takes nothing."""

    address = ""
    is_websocket = False
    is_behind = False  # some of what was written waits for the client
    on_drained: Callable[[], None] | None = None  # called when nothing waits any more
    _upper: UpperTransport | None = None
    _timer: asyncio.TimerHandle | None = None  # deadline of the client's handshake, request or body
    _stall: asyncio.TimerHandle | None = None  # deadline of the client's reading
    _first = b""
    _is_shaking = False
    _n_taken = 0  # bytes, since the last look
    _body_since_s = 0.0
    _body_waited_s = 0.0  # since the last look
    _sent_since_s = 0.0
    _n_sent = 0

    def __init__(
        self,
        connections: ClientConnections,
        handshakes: ClientConnections,
        context: ssl.SSLContext | None,
        config: uvicorn.Config,
        server_state: ServerState,
        app_state: dict[str, Any],
        _loop: asyncio.AbstractEventLoop | None = None,
    ) -> None:
        """The first three are of the service, the others what uvicorn gives a protocol."""
        self._connections = connections
        self._handshakes = handshakes
        self._context = context
        self._loop = _loop or asyncio.get_running_loop()
        self._app_state = app_state
        self._http = partial(H11Protocol, config, server_state, _loop=self._loop)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Count it, or close it before anything is made for it."""
        self._network = cast(asyncio.Transport, transport)
        peer = transport.get_extra_info("peername")
        self.address = str(peer[0]) if peer else ""
        if not self._connections.add(self):
            self._network.abort()
            return
        self._network.set_write_buffer_limits(high=0)  # paused as soon as anything waits
        made: socket.socket | None = transport.get_extra_info("socket")
        option = getattr(socket, "TCP_NOTSENT_LOWAT", None)
        if made is not None and option is not None:
            with contextlib.suppress(OSError):
                made.setsockopt(socket.IPPROTO_TCP, option, UNSENT_BYTES)
        self._is_shaking = self._context is not None
        if self._context is None:
            self._upper = UpperTransport(self._network)
        self._wait(HANDSHAKE_S if self._is_shaking else REQUEST_S, self._no_request)

    def data_received(self, data: bytes) -> None:
        """Pass on what the client sends."""
        self._n_taken += len(data)
        if self.is_websocket and self._sends_too_much(len(data)):
            self.cut()
            return
        if self._upper is None:
            data = self._first = self._first + data
            if not self._begin_tls(data):
                return
            self._first = b""
        upper = cast(UpperTransport, self._upper)
        try:
            plain = upper.decrypt(data)
        except ssl.SSLError:
            self._network.close()
            return
        if self._is_shaking and upper.is_secured:
            self._is_shaking = False
            self._handshakes.discard(self)
            self._n_taken = len(plain)
            self._wait(REQUEST_S, self._no_request)
        if plain and not upper.is_closing():
            if self._protocol is None:
                http = self._http(self._app_state | {CONNECTION: self})  # earlier, it would wait for garbage collection
                upper.set_protocol(http)
                http.connection_made(upper)
            cast(asyncio.Protocol, self._protocol).data_received(plain)
        if upper.has_ended and not upper.is_closing():
            self.eof_received()
            upper.close()

    def eof_received(self) -> None:
        """Pass it on; the connection is closed."""
        if self._protocol is not None:
            self._protocol.eof_received()

    def pause_writing(self) -> None:
        """The client is behind."""
        self.is_behind = True
        self._watch_answer()
        if self._protocol is not None:
            self._protocol.pause_writing()

    def resume_writing(self) -> None:
        """The client took what waited."""
        self.is_behind = False
        if self._stall is not None:
            self._stall.cancel()
        if self._protocol is not None:
            self._protocol.resume_writing()
        if self.on_drained is not None:
            self.on_drained()

    def connection_lost(self, exc: Exception | None) -> None:
        """The end, of the protocol above too."""
        self._forget()
        self.on_drained = None
        if self._upper is not None and self._protocol is not None:
            self._protocol.connection_lost(exc)
            self._upper.set_protocol(None)  # it refers to the transport

    @property
    def local_port(self) -> int:
        """Port of the service that the client connected to."""
        return int(self._network.get_extra_info("sockname")[1])

    def cut(self) -> None:
        """End it at once; it does not count any more."""
        self._forget()
        self._network.abort()

    def shutdown(self) -> None:
        """Cut it off if uvicorn, which ends all others, does not know of it."""
        if self._protocol is None:
            self.cut()

    def upgrade(self) -> bool:
        """Return whether it may become a websocket."""
        may = self._connections.upgrade(self)
        if may:
            self._stop()
        return may

    def begin_request(self) -> None:
        """The headers of a request are complete."""
        self._connections.stop_waiting(self)
        self._stop()
        self._n_taken, self._body_waited_s = 0, 0.0

    def await_body(self) -> None:
        """Begin to wait for more of a body."""
        self._body_since_s = self._loop.time()
        self._wait(max(LATE_S, BODY_S - self._body_waited_s), self._check_body)

    def got_body(self) -> None:
        """End to wait."""
        self._body_waited_s += self._loop.time() - self._body_since_s
        self._stop()

    def end_request(self, has_body_left: bool) -> None:
        """The answer is complete: the rest of the body is awaited, or the next request."""
        if self._network.is_closing():
            return
        self._connections.start_waiting(self)
        self._n_taken, self._body_waited_s = 0, 0.0
        if has_body_left:
            self.await_body()
        else:
            self._wait(REQUEST_S, self._no_request)

    @property
    def _protocol(self) -> asyncio.Protocol | None:
        return None if self._upper is None else cast(asyncio.Protocol | None, self._upper.get_protocol())

    def _begin_tls(self, first: bytes) -> bool:
        """Set up TLS for a client whose first bytes begin a ClientHello of usual size (RFC 8446, 5.1 and 4)."""
        if self._context is None or len(first) < _HEADER_BYTES:
            return False
        is_hello = first[0] == _HANDSHAKE and first[5] == _CLIENT_HELLO
        if not is_hello or int.from_bytes(first[6:9], "big") > HELLO_BYTES or not self._handshakes.add(self):
            self.cut()
            return False
        self._upper = TlsTransport(self._network, self._context)
        return True

    def _sends_too_much(self, size: int) -> bool:
        now_s = self._loop.time()
        if now_s - self._sent_since_s > SENT_S:
            self._sent_since_s, self._n_sent = now_s, 0
        self._n_sent += size
        return self._n_sent > SENT_BYTES

    def _wait(self, seconds: float, then: Callable[[], None]) -> None:
        self._stop()
        self._timer = self._loop.call_later(seconds, self._is_due, self._loop.time() + seconds, then)

    def _is_due(self, due_s: float, then: Callable[[], None]) -> None:
        late_s = self._loop.time() - due_s
        if late_s > LATE_S:
            self._wait(late_s, then)  # what the client sent meanwhile has not been read
        else:
            then()

    def _no_request(self) -> None:
        if self._is_shaking:
            self.cut()
            return
        if self._n_taken and self._upper is not None:
            self._upper.write(_LATE)
        cast(UpperTransport, self._upper).close()

    def _check_body(self) -> None:
        if self._n_taken < BODY_BYTES:
            self.cut()
            return
        self._n_taken, self._body_waited_s = 0, 0.0
        self.await_body()

    def _watch_answer(self) -> None:
        n_taken = cast(UpperTransport, self._upper).n_taken
        self._stall = self._loop.call_later(ANSWER_S, self._check_answer, n_taken)

    def _check_answer(self, before: int) -> None:
        if cast(UpperTransport, self._upper).n_taken > before:
            self._watch_answer()
        else:
            self.cut()

    def _stop(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _forget(self) -> None:
        self._connections.discard(self)
        self._handshakes.discard(self)
        self._stop()
        if self._stall is not None:
            self._stall.cancel()
            self._stall = None


class RequestLimits:
    """ASGI middleware: sets what a connection awaits of its client, and refuses a websocket too many."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on."""
        connection: Connection | None = scope.get("state", {}).get(CONNECTION)
        if connection is None:
            await self._app(scope, receive, send)
        elif scope["type"] == "http":
            await self._answer(connection, scope, receive, send)
        elif connection.upgrade():
            await self._app(scope, receive, send)
        else:
            headers = [(b"connection", b"close"), (b"retry-after", b"5")]
            await send({"type": "websocket.http.response.start", "status": 503, "headers": headers})
            await send({"type": "websocket.http.response.body", "body": b""})

    async def _answer(self, connection: Connection, scope: Scope, receive: Receive, send: Send) -> None:
        headers = dict(scope["headers"])
        has_body_left = b"transfer-encoding" in headers or headers.get(b"content-length", b"0") != b"0"
        is_answered = False
        connection.begin_request()

        async def timed_receive() -> Message:
            nonlocal has_body_left
            if is_answered or not has_body_left:
                return await receive()
            connection.await_body()
            try:
                message = await receive()
            finally:
                if not is_answered:
                    connection.got_body()
            has_body_left = message.get("more_body", False)
            return message

        async def noted_send(message: Message) -> None:
            nonlocal is_answered
            await send(message)
            if message["type"] == "http.response.body" and not message.get("more_body", False):
                is_answered = True
                connection.end_request(has_body_left)

        await self._app(scope, timed_receive, noted_send)
