"""HTTP on the wire: the server's own protocol, with limits on how many there are and how slow one is.

A limit counts what the client is late, never what the service is: a body is not judged while nobody here takes it, an
answer only for the time in which some of it waits for the client, and a connection that says nothing is closed only
after a last look at what it said.
"""

import array
import asyncio
import socket
import sys
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.utils import get_remote_addr

from app.api.web.connection_limits import ClientConnections, refuse

if sys.platform == "linux":
    import fcntl
    import termios

REQUEST_S = 20.0  # from the connection, or the answer before, to the last byte of a request's headers
BODY_S = 10.0  # of a body, in which BODY_BYTES have to come
BODY_BYTES = 5_000
ANSWER_S = 30.0  # that an answer waits for its client, in which ANSWER_BYTES have to be taken
ANSWER_BYTES = 15_000
_REFUSAL = "HTTP/1.1 {}\r\nconnection: close\r\nretry-after: 5\r\ncontent-length: 0\r\n\r\n"


def unsent_in_system(made: socket.socket | None) -> int | None:
    """Return how much of what was written the other side has not acknowledged; None where the system does not tell.

    Without it, only what the system has no room for is known to wait, and that goes in steps of megabytes.
    """
    if made is None or sys.platform != "linux":
        return None
    count = array.array("i", [0])
    try:
        fcntl.ioctl(made.fileno(), termios.TIOCOUTQ, count)
    except OSError:  # closed
        return None
    return count[0]


class HttpProtocol(H11Protocol):
    """Who says nothing, or too slowly, is cut off; one too many is not let in."""

    is_websocket = False
    connections: ClientConnections  # type: ignore[assignment]
    _state: Any = None
    _timer: asyncio.TimerHandle | None = None
    _stall: asyncio.TimerHandle | None = None
    _taken_bytes = 0
    _behind_since_s = 0.0  # the client; with a timer in `_stall`
    _behind_s = 0.0  # in all, since the last look
    _left_bytes = 0  # of an answer, when it fell behind
    _got_bytes = 0  # of it, while the client was behind, since the last look
    _has_waited = False  # for this side to take its body, since the last look

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Let it in, or close it before anything is made for it."""
        self.client = get_remote_addr(transport)  # before it is counted
        address = "" if self.client is None else self.client[0]
        if not self.connections.make_room(address, self.limit_concurrency or 1 << 30):
            refuse(address, "a connection")
            transport.abort()
            return
        super().connection_made(transport)
        transport.set_write_buffer_limits(high=0)  # told of all that waits, also of the end
        self._look()

    def connection_lost(self, exc: Exception | None) -> None:
        """The end, also of one that was not let in."""
        self._forget()
        if self.transport is not None:
            super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Count, and work on it."""
        self._taken_bytes += len(data)
        super().data_received(data)

    def handle_events(self) -> None:
        """Work on what came, then see what is awaited next."""
        super().handle_events()
        self._has_waited |= self.flow.read_paused
        self._look()

    def timeout_keep_alive_handler(self) -> None:
        """REQUEST_S is how long a request is awaited: at the server's own 5 s, clients just ask once more."""

    def on_response_complete(self) -> None:
        """The next request is awaited."""
        super().on_response_complete()
        self._look()

    def handle_websocket_upgrade(self, event: h11.Request) -> None:
        """Hand the connection on, if there is room."""
        address = "" if self.client is None else self.client[0]
        if self.connections.may_upgrade(address, self.limit_concurrency or 1 << 30):
            self._forget()
            super().handle_websocket_upgrade(event)
            return
        refuse(address, "a websocket")
        self._answer("503 Service Unavailable")

    def pause_writing(self) -> None:
        """The client is behind."""
        super().pause_writing()
        if self._stall is None:
            self._behind_since_s, self._left_bytes = self.loop.time(), self._unsent_bytes()
            self._stall = self.loop.call_later(max(0.0, ANSWER_S - self._behind_s), self._look_at_answer)

    def resume_writing(self) -> None:
        """The client took what waited."""
        super().resume_writing()
        if self._stall is not None:
            self._stall.cancel()
            self._stall = None
            self._count_answer()

    def cut(self) -> None:
        """End it at once."""
        self.connections.discard(self)  # it does not count any more
        self.transport.abort()

    def _look(self) -> None:
        """Set the timer of what is awaited from the client."""
        if self.transport.get_protocol() is not self:
            return  # a websocket by now
        state = self.conn.their_state
        if state is self._state:
            return
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        self._state = state
        self._taken_bytes = 0
        self.connections.stop_waiting(self)
        if state is h11.IDLE:
            self.connections.start_waiting(self)
            self._timer = self.loop.call_later(REQUEST_S, self._last_look)
        elif state is h11.SEND_BODY:
            self._has_waited = self._waits_for_us()
            self._timer = self.loop.call_later(BODY_S, self._look_at_body)

    def _last_look(self) -> None:
        self._timer = self.loop.call_later(0, self._no_request)  # after what came while the loop was busy

    def _no_request(self) -> None:
        if self._taken_bytes:
            self._answer("408 Request Timeout")
        else:
            self.transport.close()

    def _look_at_body(self) -> None:
        has_waited, self._has_waited = self._has_waited, self._waits_for_us()
        if self._taken_bytes < BODY_BYTES and not has_waited and not self._has_waited:
            self.cut()
            return
        self._taken_bytes = 0
        self._timer = self.loop.call_later(BODY_S, self._look_at_body)

    def _waits_for_us(self) -> bool:
        """Whether the client cannot send: nobody takes its body, or it was not yet told to go on ("100 Continue")."""
        return self.flow.read_paused or self.conn.they_are_waiting_for_100_continue

    def _look_at_answer(self) -> None:
        self._count_answer()
        if self._got_bytes < (ANSWER_BYTES if self._unsent_in_system() is not None else 1):
            self.cut()
            return
        self._behind_s, self._got_bytes = 0.0, 0
        self._stall = self.loop.call_later(ANSWER_S, self._look_at_answer)

    def _count_answer(self) -> None:
        """Add what was taken, and the time for it, since the client fell behind or since the last look."""
        now_s, left = self.loop.time(), self._unsent_bytes()
        self._behind_s += now_s - self._behind_since_s
        self._got_bytes += self._left_bytes - left
        self._behind_since_s, self._left_bytes = now_s, left

    def _unsent_bytes(self) -> int:
        return self.transport.get_write_buffer_size() + (self._unsent_in_system() or 0)

    def _unsent_in_system(self) -> int | None:
        return unsent_in_system(self.transport.get_extra_info("socket"))

    def _answer(self, status: str) -> None:
        self.transport.write(_REFUSAL.format(status).encode())
        self.transport.close()

    def _forget(self) -> None:
        for timer in (self._timer, self._stall):
            if timer is not None:
                timer.cancel()
        self._timer = self._stall = None
