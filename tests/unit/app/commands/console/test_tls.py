import hashlib
import ssl
from contextlib import suppress
from dataclasses import replace

import segno

from app.api.access.certificate import own_certificate
from app.commands.console.tls import Renewal, context_of, qr_lines
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
    renewal.look(NOW_S + 300 * DAY_S)
    assert (told, shown(context)) == ([], first.replace(":", ""))
    renewal.look(NOW_S + 310 * DAY_S)
    assert shown(context) == certificate.fingerprint.replace(":", "") != first.replace(":", "")
    assert certificate.ends_s > NOW_S + 600 * DAY_S
    assert [message.args["fingerprint"] for message in told] == [certificate.fingerprint]


def test_a_certificate_without_its_key_is_not_taken(tmp_path):
    own = own_certificate(tmp_path, [], NOW_S)
    context, told = context_of(own), []
    given = replace(own, is_own=False)
    (tmp_path / "other").mkdir()
    given.certificate.write_bytes(own_certificate(tmp_path / "other", [], NOW_S).certificate.read_bytes())
    Renewal(Settings(data=tmp_path), given, context, told.append).look(NOW_S)
    assert (told, shown(context)) == ([], own.fingerprint.replace(":", ""))


def test_the_lines_are_the_modules_of_the_code_light_on_dark():
    text = "https://192.168.100.123:8000/"
    modules = {"█": (0, 0), "▀": (0, 1), "▄": (1, 0), " ": (1, 1)}
    lines = qr_lines(text)
    rows = [[modules[each][half] for each in line] for line in lines for half in (0, 1)]
    matrix = [[int(each) for each in row] for row in segno.make(text, error="m", micro=False).matrix_iter(border=2)]
    assert rows[: len(matrix)] == matrix
    assert max(map(len, lines)) < 80
