"""The websocket on the wire: like the server's own, but a reader that takes nothing is cut off, not waited for.

Readers have nothing to say: one that sends more than SENT_BYTES within SENT_S is cut off, too.
"""

import asyncio

from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

STALL_S = 15.0  # longer than api.live waits, so that one that wakes up in time learns why it was closed
SENT_S = 10.0
SENT_BYTES = 1 << 18


class LiveProtocol(WebSocketsSansIOProtocol):
    """Closing a connection waits until its last bytes were taken; for a reader that stands still that is for ever."""

    is_websocket = True
    waits_since_s: float | None = None  # never in the way of another: the server asks it every 20 s whether it lives
    _stall: asyncio.TimerHandle | None = None
    _since_s = 0.0
    _sent_bytes = 0

    def data_received(self, data: bytes) -> None:
        """Count, and work on it."""
        now_s = self.loop.time()
        if now_s - self._since_s > SENT_S:
            self._since_s, self._sent_bytes = now_s, 0
        self._sent_bytes += len(data)
        if self._sent_bytes > SENT_BYTES:
            self.cut()
            return
        super().data_received(data)

    def cut(self) -> None:
        """End it at once."""
        self.transport.abort()

    def pause_writing(self) -> None:
        """The reader is behind: it has STALL_S."""
        super().pause_writing()
        if self._stall is None:
            self._stall = self.loop.call_later(STALL_S, self.cut)

    def resume_writing(self) -> None:
        """The reader took what waited."""
        super().resume_writing()
        self._forget()

    def connection_lost(self, exc: Exception | None) -> None:
        """The end."""
        self._forget()
        super().connection_lost(exc)

    def _forget(self) -> None:
        if self._stall is not None:
            self._stall.cancel()
            self._stall = None
