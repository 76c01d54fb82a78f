"""Trusted certificates: those of the system, of a file, or one given by its fingerprint.

A pit's certificate is self-signed: a client of a service by HTTPS names it by VOLTWALL_TRUST or by an argument.
"""

import hashlib
import os
import re
import ssl
import urllib.error
import urllib.request
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from app.errors import ConfigError
from app.words import Message, render

VARIABLE = "VOLTWALL_TRUST"
_FINGERPRINT = re.compile(r"[0-9A-Fa-f]{64}")


class _PinnedContext(ssl.SSLContext):
    """A client's context that believes certificates by their SHA-256 alone, before it sends anything."""

    fingerprints: frozenset[str] = frozenset()


def _check(connection: "ssl.SSLSocket | ssl.SSLObject") -> None:
    context = connection.context
    certificate = connection.getpeercert(binary_form=True) or b""
    digest = hashlib.sha256(certificate).hexdigest()
    if isinstance(context, _PinnedContext) and digest not in context.fingerprints:
        host = connection.server_hostname or "?"
        raise ssl.SSLCertVerificationError(
            render(Message("certificate-not-trusted", host=host, fingerprint=digest.upper()))
        )


class _PinnedSocket(ssl.SSLSocket):
    def do_handshake(self, block: bool = False) -> None:
        super().do_handshake(block)
        _check(self)


class _PinnedObject(ssl.SSLObject):
    def do_handshake(self) -> None:
        super().do_handshake()
        _check(self)


def context_for(trust: str | None) -> ssl.SSLContext:
    """Return the context of a client.

    Args:
        trust: a file of certificates (PEM), SHA-256 fingerprints with commas, or None: what VOLTWALL_TRUST says, else
            whom the system believes.

    Raises:
        ConfigError: it is neither.
    """
    return _context(trust or os.environ.get(VARIABLE) or None)


@cache
def _context(trust: str | None) -> ssl.SSLContext:
    if trust is None:
        return ssl.create_default_context()
    given = [fingerprint.strip().replace(":", "") for fingerprint in trust.split(",")]
    if all(_FINGERPRINT.fullmatch(fingerprint) for fingerprint in given):
        context = _PinnedContext(ssl.PROTOCOL_TLS_CLIENT)
        context.check_hostname = False
        context.verify_mode = ssl.CERT_NONE  # the fingerprint says more than a name
        context.fingerprints = frozenset(fingerprint.lower() for fingerprint in given)
        context.sslsocket_class, context.sslobject_class = _PinnedSocket, _PinnedObject
        return context
    try:
        return ssl.create_default_context(cafile=str(Path(trust).expanduser()))
    except (OSError, ValueError) as error:
        raise ConfigError("trust", trust, Message("trust-form")) from error


def opener(trust: str | None) -> urllib.request.OpenerDirector:
    """Return what asks a service: by the context of `trust`, and never sent on to another server.

    Raises:
        ConfigError: as `context_for`.
    """
    return urllib.request.build_opener(_SameServer, urllib.request.HTTPSHandler(context=context_for(trust)))


class _SameServer(urllib.request.HTTPRedirectHandler):
    """Follows a redirect within the server that was named, never to another one: the password would go with it."""

    def redirect_request(self, req: Any, fp: Any, code: int, msg: str, headers: Any, newurl: str) -> Any:
        """Return the request that follows.

        Raises:
            HTTPError: it goes to another server, port or scheme.
        """
        was, becomes = urlsplit(req.full_url), urlsplit(newurl)
        if (was.scheme, was.netloc) != (becomes.scheme, becomes.netloc):
            raise urllib.error.HTTPError(req.full_url, code, f"sends us on to {becomes.netloc}", headers, fp)
        return super().redirect_request(req, fp, code, msg, headers, newurl)
