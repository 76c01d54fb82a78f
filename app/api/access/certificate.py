"""The certificate of `--tls`: self-signed, for every name and address of this machine, kept in the data folder.

It is made anew where it ends soon, or where the machine has a name or an address that it does not hold; what it held
before it holds on, so a laptop that comes back to an earlier network shows the same fingerprint.
"""

import hashlib
import socket
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from ipaddress import ip_address
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from app.errors import ConfigError
from app.sources.data_file import replace_file
from app.words import Message

CERTIFICATE, KEY = "tls-certificate.pem", "tls-key.pem"
LASTS = timedelta(days=397)  # browsers refuse more than 398
RENEWED_BEFORE = timedelta(days=90)  # time before its end
DAY_S = 86400.0
WARNED_BEFORE_DAYS = 14
MADE_BEFORE = timedelta(days=1)  # for clients whose clock is behind
NOT_BEFORE = datetime(2026, 1, 1, tzinfo=UTC)  # the clock of a computer without a battery may stand in 1970
MOST_NAMES = 50  # that it held before


@dataclass(slots=True)
class Certificate:
    """Files of a certificate and its key; the fingerprint is the SHA-256 of the certificate, as browsers show it.

    A service has one for its life, and takes over what a renewal changes.
    """

    certificate: Path
    key: Path
    fingerprint: str
    ends_s: float  # unix time
    is_own: bool  # made by `--tls`

    def take(self, renewed: "Certificate") -> None:
        """Become the renewed one; the files are the same."""
        self.fingerprint, self.ends_s = renewed.fingerprint, renewed.ends_s

    def problem(self, now_s: float) -> Message | None:
        """That it ends soon, or has ended: nobody trusts it then."""
        days = (self.ends_s - now_s) / DAY_S
        return Message("certificate-ends", days=max(0, int(days))) if days < WARNED_BEFORE_DAYS else None


def given_certificate(certificate: Path, key: Path) -> Certificate:
    """Return a certificate of the user's.

    Raises:
        ConfigError: the file cannot be read, or is no certificate.
    """
    try:
        parsed = x509.load_pem_x509_certificate(certificate.read_bytes())
    except (OSError, ValueError) as error:
        raise ConfigError("tls_cert", certificate, _reason(error)) from error
    return _described(parsed, certificate, key, is_own=False)


def own_certificate(folder: Path, addresses: Sequence[str], now_s: float) -> Certificate:
    """Return the certificate in a folder, made or renewed where that is due.

    Args:
        folder: the data folder.
        addresses: under which other machines reach this one; loopback and the host's name are added.
        now_s: unix time.

    Raises:
        ConfigError: the files cannot be written.
    """
    now = max(datetime.fromtimestamp(now_s, UTC), NOT_BEFORE)
    paths = folder / CERTIFICATE, folder / KEY
    wanted = _names(addresses)
    held = _read(*paths)
    names = wanted if held is None else [*wanted, *(name for name in _names_of(held) if name not in wanted)]
    if held is not None and set(wanted) <= set(_names_of(held)) and _is_good(held, now):
        return _described(held, *paths, is_own=True)
    key = ec.generate_private_key(ec.SECP256R1())
    made = _sign(key, names[:MOST_NAMES], now)
    private = serialization.PrivateFormat.PKCS8
    try:
        replace_file(
            paths[1],
            key.private_bytes(serialization.Encoding.PEM, private, serialization.NoEncryption()),
            is_private=True,
        )
        replace_file(paths[0], made.public_bytes(serialization.Encoding.PEM), is_private=True)
    except OSError as error:
        raise ConfigError("data", folder, _reason(error)) from error
    return _described(made, *paths, is_own=True)


def _names(addresses: Sequence[str]) -> list[str]:
    host = socket.gethostname().lower()
    names = [host, f"{host}.local"] if host.isascii() and "." not in host else [host] if host.isascii() else []
    return list(dict.fromkeys([*addresses, *names, "localhost", "127.0.0.1", "::1"]))


def _read(certificate: Path, key: Path) -> x509.Certificate | None:
    """The certificate, None where there is none or the key is not its own."""
    try:
        parsed = x509.load_pem_x509_certificate(certificate.read_bytes())
        private = serialization.load_pem_private_key(key.read_bytes(), None)
    except (OSError, ValueError, TypeError):
        return None
    return parsed if private.public_key() == parsed.public_key() else None


def _is_good(certificate: x509.Certificate, now: datetime) -> bool:
    return certificate.not_valid_before_utc <= now < certificate.not_valid_after_utc - RENEWED_BEFORE


def _names_of(certificate: x509.Certificate) -> list[str]:
    names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    return [*map(str, names.get_values_for_type(x509.DNSName)), *map(str, names.get_values_for_type(x509.IPAddress))]


def _sign(key: ec.EllipticCurvePrivateKey, names: Sequence[str], now: datetime) -> x509.Certificate:
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "Voltwall")])
    usage = dict.fromkeys(
        ("content_commitment", "key_encipherment", "data_encipherment", "key_agreement", "key_cert_sign", "crl_sign"),
        False,
    )
    public = key.public_key()
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject)
        .public_key(public)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - MADE_BEFORE)
        .not_valid_after(now - MADE_BEFORE + LASTS)
        .add_extension(x509.SubjectAlternativeName([_general_name(name) for name in names]), critical=False)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(
            x509.KeyUsage(digital_signature=True, encipher_only=False, decipher_only=False, **usage), critical=True
        )
        .add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH]), critical=False)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(public), critical=False)
        .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(public), critical=False)
        .sign(key, hashes.SHA256())
    )


def _general_name(name: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ip_address(name))
    except ValueError:
        return x509.DNSName(name)


def _described(parsed: x509.Certificate, certificate: Path, key: Path, *, is_own: bool) -> Certificate:
    digest = hashlib.sha256(parsed.public_bytes(serialization.Encoding.DER)).hexdigest().upper()
    fingerprint = ":".join(digest[at : at + 2] for at in range(0, len(digest), 2))
    return Certificate(certificate, key, fingerprint, parsed.not_valid_after_utc.timestamp(), is_own)


def _reason(error: Exception) -> Message:
    if isinstance(error, OSError):
        return Message("verbatim", text=error.strerror or str(error))
    return Message("no-certificate")
