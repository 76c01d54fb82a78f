"""The websocket on the wire: like the server's own, but a reader that takes nothing is cut off, not waited for.

What all readers get is framed once and written as it is, past the server's own bookkeeping, which sees only what
belongs to one connection: handshake, pings, close. Messages are compressed each by itself (permessage-deflate without
context), so that those who take it share one compressed frame, too, and no connection needs a window of its own.

Readers have nothing to say: one that sends more than SENT_BYTES within SENT_S is cut off.

An open stream has no task, and nothing of its request is kept (`hand_over`); what referred to itself is cut at the end.
Else a reader costs 39 kB, half of which waits for the full garbage collection when it has left.
"""

import asyncio
import contextlib
import logging
import socket
from collections.abc import Callable
from typing import Any, cast

from uvicorn.protocols.utils import get_remote_addr
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.extensions.permessage_deflate import PerMessageDeflate, ServerPerMessageDeflateFactory
from websockets.frames import Frame, Opcode
from websockets.protocol import State
from websockets.server import ServerProtocol

SLOW_S = 10.0  # a message that is not taken within this time ends the connection
STALL_S = 15.0  # longer, so that one that wakes up in time learns why it was closed
SENT_S = 10.0
SENT_BYTES = 1 << 18
UNSENT_BYTES = 1 << 16  # in the system, of one connection: what waits there is old when it arrives
READER = "voltwall.reader"  # in the scope: the connection itself
WINDOW_BITS = 15
_DEFLATE = {"level": 3}  # of a snapshot of 96 cells 25 % in 0.3 ms; level 6: 23 % in 0.7 ms


def text_frame(body: bytes, is_compressed: bool) -> bytes:
    """Return a message of a server as it goes over the wire."""
    extensions = [PerMessageDeflate(True, True, WINDOW_BITS, WINDOW_BITS, _DEFLATE)] if is_compressed else []
    return Frame(Opcode.TEXT, body).serialize(mask=False, extensions=extensions)


class LiveProtocol(WebSocketsSansIOProtocol):
    """Closing a connection waits until its last bytes were taken; for a reader that stands still that is for ever."""

    is_websocket = True
    is_compressed = False
    on_drained: Callable[[], None] | None = None
    _is_behind = False
    _is_handed_over = False
    _kept_open: asyncio.TimerHandle | None = None
    _stall: asyncio.TimerHandle | None = None
    _since_s = 0.0
    _sent_bytes = 0
    _n_received = 0

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self.conn = self._speaks(State.CONNECTING)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep little on the way: who is slow misses messages and gets the newest."""
        self.client = get_remote_addr(cast(asyncio.Transport, transport))  # before it is counted
        super().connection_made(transport)
        self.transport.set_write_buffer_limits(high=0)
        made: socket.socket | None = transport.get_extra_info("socket")
        option = getattr(socket, "TCP_NOTSENT_LOWAT", None)
        if made is not None and option is not None:
            with contextlib.suppress(OSError):
                made.setsockopt(socket.IPPROTO_TCP, option, UNSENT_BYTES)

    async def run_asgi(self) -> None:
        """Hand the connection on with its scope."""
        cast(dict[str, Any], self.scope)[READER] = self
        self.is_compressed = any(
            isinstance(each, PerMessageDeflate) and each.local_max_window_bits == WINDOW_BITS
            for each in self.conn.extensions
        )
        await super().run_asgi()
        for name in ("scope", "request", "response"):
            vars(self).pop(name, None)
        if self._kept_open is not None and self.close_timer is self._kept_open:
            self.close_timer = self._kept_open = None
            if self._n_received == 1 and self.conn.state is State.OPEN:
                shaken, self.conn = self.conn, self._speaks(State.OPEN)  # without the request, which that one keeps
                self.conn.extensions = shaken.extensions
                shaken.parser.close()
        if self.disconnected:
            self.conn.parser.close()

    def hand_over(self, on_end: Callable[[], None]) -> None:
        """Stay open when the application returns, take nothing more in, and call `on_end` when it ends."""
        events, self.queue = self.queue, cast(asyncio.Queue[Any], _Ending(on_end))
        while not events.empty():
            self.queue.put_nowait(events.get_nowait())
        self._is_handed_over = True
        if self.close_timer is None:  # or the server closes the connection when the application returns
            self.close_timer = self._kept_open = asyncio.TimerHandle(0.0, lambda: None, (), self.loop)
        if self.read_paused:
            self.read_paused = False
            self.transport.resume_reading()

    def write_frame(self, frame: bytes) -> bool:
        """Write a whole frame; False where the one before is not taken yet, or it is closed."""
        if self._is_behind or self.close_sent or self.transport.is_closing():
            return False
        self.transport.write(frame)
        return True

    def end(self, code: int, reason: str) -> None:
        """Close it, and tell why once what waits was taken; the application's `send` would wait for that."""
        if self.close_sent or self.transport.is_closing():
            return
        self.queue.put_nowait({"type": "websocket.disconnect", "code": code, "reason": reason})
        self.conn.send_close(code, reason)
        self.close_sent = True
        self.transport.write(b"".join(self.conn.data_to_send()))
        if self.read_paused:
            self.read_paused = False
            self.transport.resume_reading()
        self.close_timer = self.loop.call_later(self.close_timeout, self.transport.close)

    def data_received(self, data: bytes) -> None:
        """Count, and work on it."""
        self._n_received += 1
        if self._may_send(len(data)):
            super().data_received(data)

    def send_receive_event_to_app(self) -> None:
        """Count what it was before it was compressed, too."""
        if not self._may_send(sum(map(len, self.frames))):
            return
        if self._is_handed_over:
            self.frames = []
        else:
            super().send_receive_event_to_app()

    def cut(self) -> None:
        """End it at once."""
        self.transport.abort()

    def pause_writing(self) -> None:
        """The reader is behind: it has STALL_S."""
        super().pause_writing()
        self._is_behind = True
        if self._stall is None:
            self._stall = self.loop.call_later(SLOW_S, self._is_slow)

    def resume_writing(self) -> None:
        """The reader took what waited."""
        super().resume_writing()
        self._is_behind = False
        self._forget()
        if self.on_drained is not None:
            self.on_drained()

    def connection_lost(self, exc: Exception | None) -> None:
        """The end."""
        self._forget()
        super().connection_lost(exc)
        self.on_drained = None
        if "scope" not in vars(self):
            self.conn.parser.close()

    def _speaks(self, state: State) -> ServerProtocol:
        factory = ServerPerMessageDeflateFactory(server_no_context_takeover=True, client_no_context_takeover=True)
        return ServerProtocol(
            extensions=[factory],
            state=state,
            max_size=self.config.ws_max_size,
            logger=logging.getLogger("uvicorn.error"),
        )

    def _may_send(self, size: int) -> bool:
        now_s = self.loop.time()
        if now_s - self._since_s > SENT_S:
            self._since_s, self._sent_bytes = now_s, 0
        self._sent_bytes += size
        if self._sent_bytes > SENT_BYTES:
            self.cut()
            return False
        return True

    def _is_slow(self) -> None:
        self._stall = self.loop.call_later(STALL_S - SLOW_S, self.cut)
        self.end(1013, "too slow")

    def _forget(self) -> None:
        if self._stall is not None:
            self._stall.cancel()
            self._stall = None


class _Ending:
    """In place of the queue of events that an application waits for: the end is told once, the rest dropped."""

    def __init__(self, on_end: Callable[[], None]) -> None:
        self._on_end: Callable[[], None] | None = on_end

    def put_nowait(self, event: dict[str, Any]) -> None:
        """Take an event."""
        if event["type"] == "websocket.disconnect" and self._on_end is not None:
            on_end, self._on_end = self._on_end, None
            on_end()
