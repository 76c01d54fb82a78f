import hashlib
import ssl
from contextlib import suppress
from dataclasses import replace

from app.api.access.certificate import own_certificate
from app.commands.tls import Renewal, certificate_text, context_of
from app.service.settings import Settings

NOW_S, DAY_S = 1_795_000_000.0, 86400.0


def shown(context):
    """The SHA-256 of the certificate that a client sees now."""
    client = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    client.check_hostname, client.verify_mode = False, ssl.CERT_NONE
    to_server, to_client = ssl.MemoryBIO(), ssl.MemoryBIO()
    sides = [context.wrap_bio(to_server, to_client, server_side=True), client.wrap_bio(to_client, to_server)]
    for side in [*reversed(sides)] * 3:
        with suppress(ssl.SSLWantReadError):
            side.do_handshake()
    return hashlib.sha256(sides[1].getpeercert(binary_form=True)).hexdigest().upper()


def test_a_certificate_of_our_own_is_renewed_while_the_service_runs(tmp_path):
    certificate = own_certificate(tmp_path, ["10.0.0.7"], NOW_S)
    first, context, told = certificate.fingerprint, context_of(certificate), []
    renewal = Renewal(Settings(data=tmp_path, tls=True), certificate, context, told.append)
    renewal.check(NOW_S + 300 * DAY_S)
    assert (told, shown(context)) == ([], first.replace(":", ""))
    renewal.check(NOW_S + 310 * DAY_S)
    assert shown(context) == certificate.fingerprint.replace(":", "") != first.replace(":", "")
    assert certificate.ends_s > NOW_S + 600 * DAY_S
    assert [message.args["fingerprint"] for message in told] == [certificate.fingerprint]


def test_a_certificate_without_its_key_is_not_taken(tmp_path):
    own = own_certificate(tmp_path, [], NOW_S)
    context, told = context_of(own), []
    given = replace(own, is_own=False)
    (tmp_path / "other").mkdir()
    given.certificate.write_bytes(own_certificate(tmp_path / "other", [], NOW_S).certificate.read_bytes())
    Renewal(Settings(data=tmp_path), given, context, told.append).check(NOW_S)
    assert (told, shown(context)) == ([], own.fingerprint.replace(":", ""))


def test_a_terminal_shows_the_fingerprint_and_a_code_for_phones(tmp_path, monkeypatch):
    own = own_certificate(tmp_path, ["10.0.0.7"], NOW_S)
    settings = Settings(data=tmp_path, tls=True, host="10.0.0.7")
    fingerprint = f"certificate SHA-256 {own.fingerprint}"
    assert certificate_text(own, settings, 8000) == fingerprint
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    first, *code, url = certificate_text(own, settings, 8000).split("\n")
    assert (first, url) == (fingerprint, "https://10.0.0.7:8000/")
    assert len(set(map(len, code))) == 1
    assert set("".join(code)) == set("█▀▄ ")
