"""TLS of `voltwall serve`: which certificate, and what the terminal shows of it."""

import asyncio
import logging
import ssl
import sys
from collections.abc import Callable
from io import StringIO

import segno

from app.api.access.certificate import Certificate, given_certificate, own_certificate
from app.clock import Clock
from app.errors import ConfigError
from app.service.host import addresses_of
from app.service.settings import Settings
from app.words import Message

log = logging.getLogger(__name__)
CHECK_S = 3600.0


def certificate_of(settings: Settings) -> Certificate | None:
    """Return the certificate to serve with, None for HTTP.

    Raises:
        ConfigError: a file cannot be read, written or used.
    """
    if settings.tls_cert is not None and settings.tls_key is not None:
        return given_certificate(settings.tls_cert, settings.tls_key)
    if not settings.tls:
        return None
    every = "0.0.0.0" if settings.is_loopback else settings.host
    return own_certificate(settings.data, addresses_of(every), Clock().wall_s())


def context_of(certificate: Certificate) -> ssl.SSLContext:
    """Return the context of a server: TLS 1.2 or newer.

    Raises:
        ConfigError: the key is not that of the certificate.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    context.options |= ssl.OP_NO_RENEGOTIATION
    try:
        context.load_cert_chain(certificate.certificate, certificate.key, password=lambda: "")
    except (OSError, ValueError) as error:
        raise ConfigError("tls_key", certificate.key, Message("key-of-certificate")) from error
    return context


class Renewal:
    """Keeps the certificate of a running service in date; connections that are open keep the old one."""

    def __init__(
        self, settings: Settings, certificate: Certificate, context: ssl.SSLContext, tell: Callable[[Message], None]
    ) -> None:
        self._settings = settings
        self._certificate = certificate
        self._context = context
        self._tell = tell

    def check(self, now_s: float) -> None:
        """Take one that `--tls` makes before the end of the old one, or that somebody put in the place of theirs."""
        settings, own = self._settings, self._certificate
        try:
            if own.is_own:
                certificate = own_certificate(
                    settings.data, (), now_s
                )  # other networks' addresses are in it from the next start
            else:
                certificate = given_certificate(own.certificate, own.key)
            if certificate.fingerprint == own.fingerprint:
                return
            context_of(certificate)  # whether key and certificate belong together, before the one in use is touched
            self._context.load_cert_chain(certificate.certificate, certificate.key, password=lambda: "")
        except (ConfigError, OSError) as error:
            log.warning("certificate: %s", error)
            return
        own.take(certificate)
        self._tell(Message("certificate-renewed", fingerprint=certificate.fingerprint))

    async def keep(self) -> None:
        """Look each hour, for ever."""
        while True:
            await asyncio.sleep(CHECK_S)
            await asyncio.to_thread(self.check, Clock().wall_s())


def certificate_text(certificate: Certificate, settings: Settings, port: int) -> str:
    """Return what the terminal shows: the fingerprint, and for phones the addresses, the first as a QR code."""
    lines = [f"certificate SHA-256 {certificate.fingerprint}"]
    urls = [f"https://{f'[{a}]' if ':' in a else a}:{port}/" for a in addresses_of(settings.host)]
    if urls and sys.stdout.isatty():
        code = StringIO()
        segno.make(urls[0], error="m", micro=False).terminal(code, border=2, compact=True)
        lines += [code.getvalue().rstrip("\n"), *urls]
    return "\n".join(lines)
