"""Access for phones: a second listener, on every address of this machine by HTTPS, opened while the service runs.

It needs a password first, and stays open over restarts until it is turned off.
"""

import contextlib
import threading
import time
from collections.abc import Callable
from pathlib import Path

from app.api.access.certificate import Certificate, given_certificate, own_certificate
from app.errors import AppError, ConfigError
from app.service.host import addresses_of
from app.service.settings import Settings
from app.sources.data_file import parse_object, replace_file

FILE = "phones.json"
PORT = 8443
EVERY = "0.0.0.0"

Listen = Callable[[Certificate, int], int]  # opens the listener at a port, 0 for a free one; returns the port


class PhoneAccess:
    """Turns the listener on and off; `listen` and `close` are the server's."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._file: Path = settings.data / FILE
        self._lock = threading.Lock()
        self.listen: Listen | None = None
        self.is_open_to_all: Callable[[], bool] = lambda: True  # no password is set
        self.close: Callable[[], None] = lambda: None
        self.port: int | None = None  # None: off
        self.certificate: Certificate | None = None

    @property
    def is_possible(self) -> bool:
        """True where the service itself listens on this machine alone, so that phones need another listener."""
        return self._settings.is_loopback and self.listen is not None

    @property
    def urls(self) -> list[str]:
        """Addresses that a phone on the same network opens."""
        return [] if self.port is None else [f"https://{address}:{self.port}/" for address in addresses_of(EVERY)]

    def turn_on(self) -> None:
        """Open it, and again after a restart.

        Raises:
            ConfigError: the certificate or the file cannot be written, or no port is free.
        """
        with self._lock:
            if self.port is not None or self.listen is None:
                return
            certificate = self._certificate()
            try:
                port = self.listen(certificate, self._kept_port() or PORT)
            except ConfigError:  # another program has that port
                port = self.listen(certificate, 0)
            self.port, self.certificate = port, certificate
            try:
                replace_file(self._file, f'{{"port": {port}}}\n'.encode())
            except OSError as error:
                raise ConfigError("data", self._file, str(error)) from error

    def turn_off(self) -> None:
        """Close it, and end what is connected by it."""
        with self._lock:
            self._file.unlink(missing_ok=True)
            if self.port is not None:
                self.close()
            self.port = self.certificate = None

    def resume(self) -> None:
        """Open it where it was before the restart, if a password is still set; where that fails the service runs on."""
        if self._kept_port() is not None and not self.is_open_to_all():
            with contextlib.suppress(AppError, OSError):
                self.turn_on()

    def _kept_port(self) -> int | None:
        with contextlib.suppress(OSError, ValueError):
            port = parse_object(self._file.read_bytes()).get("port")
            return port if isinstance(port, int) and 0 < port < 1 << 16 else None
        return None

    def _certificate(self) -> Certificate:
        given = self._settings
        if given.tls_cert is not None and given.tls_key is not None:
            return given_certificate(given.tls_cert, given.tls_key)
        return own_certificate(given.data, addresses_of(EVERY), time.time())
