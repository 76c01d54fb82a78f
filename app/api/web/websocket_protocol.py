"""The websocket on the wire: like the server's own, but a reader that takes nothing is cut off, not waited for."""

import asyncio

from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

STALL_S = 15.0  # longer than api.live waits, so that one that wakes up in time learns why it was closed


class LiveProtocol(WebSocketsSansIOProtocol):
    """Closing a connection waits until its last bytes were taken; for a reader that stands still that is for ever."""

    _stall: asyncio.TimerHandle | None = None

    def pause_writing(self) -> None:
        """The reader is behind: it has STALL_S."""
        super().pause_writing()
        if self._stall is None:
            self._stall = self.loop.call_later(STALL_S, self.transport.abort)

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
