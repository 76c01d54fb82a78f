"""Byte ports that look like hardware: a pseudo-terminal behind a link, or a TCP socket on the loopback.

Nobody has to listen. What a reader does not take in time is lost, as on a real UART; readers may come and go.
"""

import contextlib
import os
import selectors
import socket
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from simulator.errors import PortError

if sys.platform != "win32":
    import pty
    import termios
    import tty

LOOPBACK = "127.0.0.1"
_CHUNK = 4096
_INPUT_SPEED, _OUTPUT_SPEED = 4, 5  # places in termios's list


class BytePort(Protocol):
    """A port for bytes, driven by the runner's selector."""

    @property
    def url(self) -> str:
        """Return the URL with which pySerial opens the other end."""
        ...

    def open(self, selector: selectors.BaseSelector, on_data: Callable[[bytes], None]) -> None:
        """Open, and hand over what arrives; PortError where that fails."""
        ...

    def write(self, data: bytes) -> None:
        """Send what the other end has room for; the rest is lost."""
        ...

    def tend(self) -> None:
        """Do periodic maintenance."""
        ...

    def close(self) -> None:
        """Close, and remove what was created."""
        ...


class PtyPort:
    """A pseudo-terminal with a link to it; a link that an earlier run left behind is replaced."""

    def __init__(self, link: str) -> None:
        self._link = Path(link).absolute()
        self._master = self._slave = -1
        self._selector: selectors.BaseSelector | None = None

    @property
    def url(self) -> str:
        """The link's path."""
        return str(self._link)

    def open(self, selector: selectors.BaseSelector, on_data: Callable[[bytes], None]) -> None:
        """Open the terminal and make the link."""
        if sys.platform == "win32":
            raise PortError(f"pty:{self._link}", "Windows has no pseudo-terminals: use tcp:PORT")
        if self._link.exists() and not self._link.is_symlink():
            raise PortError(f"pty:{self._link}", "a file is in the way, only links are replaced")
        try:
            self._master, self._slave = pty.openpty()
            tty.setraw(self._slave)
            os.set_blocking(self._master, False)
            self._link.unlink(missing_ok=True)
            self._link.symlink_to(os.ttyname(self._slave))
        except OSError as error:
            raise PortError(f"pty:{self._link}", str(error)) from error
        self._selector = selector
        selector.register(self._master, selectors.EVENT_READ, lambda: self._read(on_data))

    def _read(self, on_data: Callable[[bytes], None]) -> None:
        with contextlib.suppress(BlockingIOError):
            on_data(os.read(self._master, _CHUNK))

    def write(self, data: bytes) -> None:
        """Send what the terminal's buffer has room for."""
        if self._master < 0:
            return
        with contextlib.suppress(BlockingIOError):
            os.write(self._master, data)

    def tend(self) -> None:
        """Set the terminal's speed to one that nobody asks for.

        Pseudo-terminals know no parity. Setting it is accepted along with another change and refused alone, so whoever
        opens the port a second time has to find something else to change.
        """
        if self._master < 0 or sys.platform == "win32":
            return
        attributes = termios.tcgetattr(self._slave)
        if attributes[_OUTPUT_SPEED] != termios.B50:
            attributes[_INPUT_SPEED] = attributes[_OUTPUT_SPEED] = termios.B50
            termios.tcsetattr(self._slave, termios.TCSANOW, attributes)

    def close(self) -> None:
        """Close both ends; a reader loses the device."""
        if self._master < 0:
            return
        if self._selector is not None:
            self._selector.unregister(self._master)
        if self._link.is_symlink() and str(self._link.readlink()) == os.ttyname(self._slave):
            self._link.unlink()
        os.close(self._master)
        os.close(self._slave)
        self._master = self._slave = -1


class TcpPort:
    """A listening socket on the loopback that serves one client at a time; the next one is welcome afterwards."""

    def __init__(self, port: int) -> None:
        self._port = port
        self._listener: socket.socket | None = None
        self._client: socket.socket | None = None
        self._selector: selectors.BaseSelector | None = None
        self._on_data: Callable[[bytes], None] = _ignore

    @property
    def url(self) -> str:
        """A `socket://` URL, with the port that was chosen if 0 was asked for."""
        return f"socket://{LOOPBACK}:{self._port}"

    def open(self, selector: selectors.BaseSelector, on_data: Callable[[bytes], None]) -> None:
        """Listen."""
        try:
            self._listener = socket.create_server((LOOPBACK, self._port), backlog=1)
        except OSError as error:
            raise PortError(f"tcp:{self._port}", str(error)) from error
        self._port = int(self._listener.getsockname()[1])
        self._listener.setblocking(False)
        self._selector = selector
        self._on_data = on_data
        selector.register(self._listener, selectors.EVENT_READ, self._accept)

    def _accept(self) -> None:
        if self._listener is None or self._selector is None:
            return
        with contextlib.suppress(OSError):
            client, _ = self._listener.accept()
            client.setblocking(False)
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._client = client
            self._selector.register(client, selectors.EVENT_READ, self._read)
            self._selector.unregister(self._listener)

    def _read(self) -> None:
        if self._client is None:
            return
        try:
            data = self._client.recv(_CHUNK)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if data:
            self._on_data(data)
        else:
            self._drop_client()

    def write(self, data: bytes) -> None:
        """Send what the client's window has room for."""
        if self._client is None:
            return
        try:
            self._client.send(data)
        except BlockingIOError:
            return
        except OSError:
            self._drop_client()

    def tend(self) -> None:
        """Do nothing: sockets need no maintenance."""

    def _drop_client(self) -> None:
        if self._client is None or self._selector is None or self._listener is None:
            return
        self._selector.unregister(self._client)
        self._client.close()
        self._client = None
        self._selector.register(self._listener, selectors.EVENT_READ, self._accept)

    def close(self) -> None:
        """Close the client and stop listening."""
        if self._listener is None or self._selector is None:
            return
        self._drop_client()
        self._selector.unregister(self._listener)
        self._listener.close()
        self._listener = None


def byte_port(text: str) -> BytePort:
    """Return the port that `pty:LINK` or `tcp:PORT` names, not yet open.

    Raises:
        PortError: it names neither.
    """
    kind, _, rest = text.partition(":")
    if kind == "pty" and rest:
        return PtyPort(rest)
    if kind == "tcp" and rest.isdecimal() and len(rest) <= 5 and int(rest) <= 0xFFFF:
        return TcpPort(int(rest))
    raise PortError(text, "give pty:LINK or tcp:PORT")


def _ignore(data: bytes) -> None:
    """Nobody asked for these bytes."""
