"""Requests and their replies, without I/O: sequence numbers, matching, time-outs and tries. Time is an argument.

The host has one request outstanding. One that stays unanswered is sent again, byte for byte; the master knows a
repeated one by its type, sequence and body and answers it without doing it twice, so any request may be repeated.
"""

from dataclasses import dataclass

from firmware_protocol.errors import ProtocolError
from firmware_protocol.framing import encode_frame
from firmware_protocol.messages import MessageType, Reply, Request, encode_request

TIMEOUT_S = 0.6  # a 512-byte frame ahead of the reply takes 50 ms, the reply itself as long
STORE_TIMEOUT_S = 3.0  # page writes of 5 ms and their verification
TRIES = 3
REPEAT_WINDOW_S = 10.0  # longer than all tries of the slowest request; then the same bytes are a new request
_SLOW_REQUESTS = (MessageType.STORE, MessageType.LOAD)


class ExchangeBusyError(ProtocolError):
    """A request is outstanding already."""


@dataclass(frozen=True, slots=True)
class GaveUp:
    """No reply after all tries: the request may or may not have been carried out."""

    request: Request
    tries: int


class Exchange:
    """The host's side of one line."""

    def __init__(self, first_sequence: int = 0, *, tries: int = TRIES) -> None:
        self._sequence = first_sequence & 0xFF
        self._tries = tries
        self._request: Request | None = None
        self._kind = MessageType.IDENT
        self._frame = b""
        self._sent = 0
        self._deadline_s = 0.0
        self.stray_replies = 0

    @property
    def is_busy(self) -> bool:
        """A request is outstanding."""
        return self._request is not None

    @property
    def deadline_s(self) -> float | None:
        """When `poll` wants to be called, None while nothing is outstanding."""
        return self._deadline_s if self.is_busy else None

    def start(self, request: Request, now_s: float) -> bytes:
        """Return the frame to send.

        Raises:
            ExchangeBusyError: a request is outstanding.
            EncodeError: the request does not fit its frame.
        """
        if self.is_busy:
            raise ExchangeBusyError("one request at a time")
        kind, body = encode_request(request)
        self._frame = encode_frame(kind, self._sequence, 0, body)
        self._request, self._kind, self._sent = request, kind, 0
        return self._send(now_s)

    def awaits(self, reply: Reply) -> bool:
        """Return whether the reply is one to the outstanding request."""
        return self.is_busy and (reply.request_type, reply.request_sequence) == (self._kind, self._sequence)

    def on_reply(self, reply: Reply) -> bool:
        """Return whether the reply ends the outstanding request; other replies are counted and dropped."""
        if not self.awaits(reply):
            self.stray_replies += 1
            return False
        self._end()
        return True

    def poll(self, now_s: float) -> bytes | GaveUp | None:
        """Return the frame to send again, or that all tries are used up, or None while there is time."""
        if self._request is None or now_s < self._deadline_s:
            return None
        if self._sent < self._tries:
            return self._send(now_s)
        given_up = GaveUp(self._request, self._sent)
        self._end()
        return given_up

    def _send(self, now_s: float) -> bytes:
        self._sent += 1
        self._deadline_s = now_s + (STORE_TIMEOUT_S if self._kind in _SLOW_REQUESTS else TIMEOUT_S)
        return self._frame

    def _end(self) -> None:
        self._request = None
        self._sequence = (self._sequence + 1) & 0xFF
