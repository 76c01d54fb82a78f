"""Transports of the protocols above a connection: the network's as it is, or TLS on it, with small buffers.

What asyncio itself keeps of a TLS connection is 256 KiB and more. Here everything is encrypted when it is written, so
what a client has not taken is in the transport of the network alone: its limits, its size and its pauses are those of
the connection.
"""

import asyncio
import contextlib
import ssl
from typing import Any

RECORD = 1 << 14  # bytes of a TLS record; a buffer of OpenSSL never shrinks, so nothing larger goes into one


class UpperTransport(asyncio.Transport):
    """The network's transport, for the protocol above a connection."""

    is_secured = True  # the handshake is complete, where there is one
    has_ended = False  # the client sends no more

    def __init__(self, network: asyncio.Transport) -> None:
        super().__init__()
        self._network = network
        self._protocol: asyncio.BaseProtocol | None = None
        self._n_written = 0

    @property
    def n_taken(self) -> int:
        """Return how many bytes the system has taken, as they go over the network."""
        return self._n_written - self._network.get_write_buffer_size()

    def decrypt(self, received: bytes) -> bytes:
        """Return what the client sent to the protocol above."""
        return received

    def write(self, data: bytes | bytearray | memoryview) -> None:
        """Send."""
        if not self._network.is_closing():
            self._put(data)

    def _put(self, data: bytes | bytearray | memoryview) -> None:
        self._n_written += len(data)
        self._network.write(data)

    def close(self) -> None:
        """Send what waits, and the end."""
        self._network.close()

    def abort(self) -> None:
        """Close without sending what waits."""
        self._network.abort()

    def is_closing(self) -> bool:
        """Return whether it is closed, or being closed."""
        return self._network.is_closing()

    def get_extra_info(self, name: str, default: Any = None) -> Any:
        """Return what the transport of the network knows."""
        return self._network.get_extra_info(name, default)

    def set_protocol(self, protocol: asyncio.BaseProtocol | None) -> None:
        """Set what gets the plain bytes; None when the connection is lost."""
        self._protocol = protocol

    def get_protocol(self) -> asyncio.BaseProtocol:
        """Return what gets the plain bytes."""
        return self._protocol  # type: ignore[return-value]  # asked of connections that have one

    def pause_reading(self) -> None:
        """Receive nothing more."""
        self._network.pause_reading()

    def resume_reading(self) -> None:
        """Receive again."""
        self._network.resume_reading()


class TlsTransport(UpperTransport):
    """The server's side of a TLS connection."""

    def __init__(self, network: asyncio.Transport, context: ssl.SSLContext) -> None:
        super().__init__(network)
        self._context = context
        self._incoming, self._outgoing = ssl.MemoryBIO(), ssl.MemoryBIO()
        self._tls = context.wrap_bio(self._incoming, self._outgoing, server_side=True)
        self.is_secured = False

    def decrypt(self, received: bytes) -> bytes:
        """Return what the client sent, in plain; the answers of TLS itself are sent.

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
        records: list[bytes] = []
        with contextlib.suppress(ssl.SSLWantReadError):
            while record := self._tls.read(RECORD):
                records.append(record)
            self.has_ended = True
        return records

    def _send(self) -> None:
        if self._outgoing.pending:
            self._put(self._outgoing.read())

    def write(self, data: bytes | bytearray | memoryview) -> None:
        """Encrypt and send."""
        with memoryview(data) as view:
            for at in range(0, len(view), RECORD):
                if self._network.is_closing():
                    return
                self._tls.write(view[at : at + RECORD])
                self._send()

    def close(self) -> None:
        """Send what waits, and the end of TLS; the client's own end is not waited for."""
        if self._network.is_closing():
            return
        with contextlib.suppress(ssl.SSLError):
            self._tls.unwrap()
        self._send()
        self._network.close()

    def get_extra_info(self, name: str, default: Any = None) -> Any:
        """Return the TLS objects, or what the transport of the network knows."""
        own = {"sslcontext": self._context, "ssl_object": self._tls}
        return own[name] if name in own else self._network.get_extra_info(name, default)
