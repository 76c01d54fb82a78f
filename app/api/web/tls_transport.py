"""TLS on a transport of the network, with small buffers: what asyncio keeps of a connection is 256 KiB and more.

Everything is encrypted when it is written, so what a client has not taken is in the transport of the network alone:
its limits, its size and its pauses are those of the connection.
"""

import asyncio
import contextlib
import ssl
from typing import Any

RECORD = 1 << 14  # bytes of a TLS record; a buffer of OpenSSL never shrinks, so nothing larger goes into one


class TlsTransport(asyncio.Transport):
    """The server's side of a TLS connection, for the protocol above it."""

    __slots__ = ("_context", "_incoming", "_network", "_outgoing", "_protocol", "_tls", "has_ended", "is_secured")

    def __init__(self, network: asyncio.Transport, context: ssl.SSLContext) -> None:
        super().__init__()
        self._network = network
        self._context = context
        self._incoming, self._outgoing = ssl.MemoryBIO(), ssl.MemoryBIO()
        self._tls = context.wrap_bio(self._incoming, self._outgoing, server_side=True)
        self._protocol: asyncio.BaseProtocol | None = None
        self.is_secured = False  # the handshake is complete
        self.has_ended = False  # the client sends no more

    def decrypt(self, received: bytes) -> bytes:
        """Return what the client sent to the protocol above; the answers of TLS itself are sent.

        Raises:
            ssl.SSLError: that is no TLS, or none that is accepted; the client was sent an alert.
        """
        plain = []
        try:
            with memoryview(received) as view:
                for at in range(0, len(view), RECORD):
                    self._incoming.write(view[at : at + RECORD])
                    with contextlib.suppress(ssl.SSLWantReadError):
                        plain += self._records()
        finally:
            self._send()
        return b"".join(plain)

    def _records(self) -> list[bytes]:
        if not self.is_secured:
            self._tls.do_handshake()
            self.is_secured = True
        found: list[bytes] = []
        with contextlib.suppress(ssl.SSLWantReadError):
            while record := self._tls.read(RECORD):
                found.append(record)
            self.has_ended = True
        return found

    def _send(self) -> None:
        if self._outgoing.pending:
            self._network.write(self._outgoing.read())

    def write(self, data: bytes | bytearray | memoryview) -> None:
        """Encrypt and send."""
        with memoryview(data) as view:
            for at in range(0, len(view), RECORD):
                if self._network.is_closing():
                    return
                self._tls.write(view[at : at + RECORD])
                self._send()

    def can_write_eof(self) -> bool:
        """Return False: TLS ends in both directions at once."""
        return False

    def close(self) -> None:
        """Send what waits, and the end of TLS; the client's own end is not waited for."""
        if self._network.is_closing():
            return
        with contextlib.suppress(ssl.SSLError):
            self._tls.unwrap()
        self._send()
        self._network.close()

    def abort(self) -> None:
        """Close without sending what waits."""
        self._network.abort()

    def is_closing(self) -> bool:
        """Return whether it is closed, or being closed."""
        return self._network.is_closing()

    def get_extra_info(self, name: str, default: Any = None) -> Any:
        """Return the TLS objects, or what the transport of the network knows."""
        known = {"sslcontext": self._context, "ssl_object": self._tls}
        return known[name] if name in known else self._network.get_extra_info(name, default)

    def set_protocol(self, protocol: asyncio.BaseProtocol | None) -> None:
        """Set what gets the plain bytes; None when the connection is lost."""
        self._protocol = protocol

    def get_protocol(self) -> asyncio.BaseProtocol:
        """Return what gets the plain bytes."""
        return self._protocol  # type: ignore[return-value]  # asked of connections that have one

    def is_reading(self) -> bool:
        """Return whether bytes are received."""
        return self._network.is_reading()

    def pause_reading(self) -> None:
        """Receive nothing more."""
        self._network.pause_reading()

    def resume_reading(self) -> None:
        """Receive again."""
        self._network.resume_reading()

    def set_write_buffer_limits(self, high: int | None = None, low: int | None = None) -> None:
        """Set from how many unsent bytes on the protocol is paused, and down to how many [encrypted bytes]."""
        self._network.set_write_buffer_limits(high, low)

    def get_write_buffer_limits(self) -> tuple[int, int]:
        """Return (low, high)."""
        return self._network.get_write_buffer_limits()

    def get_write_buffer_size(self) -> int:
        """Return how many encrypted bytes the system has not taken."""
        return self._network.get_write_buffer_size()
