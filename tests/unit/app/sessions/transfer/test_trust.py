import ssl
import urllib.error
import urllib.request

import pytest

from app.api.access.certificate import own_certificate
from app.errors import ConfigError
from app.sessions.transfer.trust import context_for, opener
from tests.http_stub import http_stub


@pytest.fixture(scope="module")
def pit(tmp_path_factory):
    """A server with a certificate of its own, and what it was asked."""
    certificate = own_certificate(tmp_path_factory.mktemp("pit"), [], 1_795_000_000.0)
    asked = []

    def answer(request):
        asked.append(request.headers.get("Authorization"))
        return 200, {}, b"ok"

    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(certificate.certificate, certificate.key)
    with http_stub(answer, context) as url:
        yield url, certificate, asked


def ask(url, trust=None):
    request = urllib.request.Request(url, headers={"Authorization": "Basic secret"})
    with opener(trust).open(request, timeout=10) as answer:
        return answer.read()


@pytest.mark.parametrize("form", ["colons", "plain", "one of two", "file"])
def test_a_certificate_is_believed_by_fingerprint_or_file(pit, form):
    url, certificate, _ = pit
    plain = certificate.fingerprint.replace(":", "").lower()
    trust = {"colons": certificate.fingerprint, "plain": plain, "one of two": "0" * 64 + ", " + plain}
    assert ask(url, trust.get(form, str(certificate.certificate))) == b"ok"


def test_the_environment_says_whom_to_trust(pit, monkeypatch):
    url, certificate, _ = pit
    monkeypatch.setenv("VOLTWALL_TRUST", certificate.fingerprint)
    assert ask(url) == b"ok"


@pytest.mark.parametrize("trust", [None, "0" * 64])
def test_to_another_certificate_nothing_is_sent(pit, trust, monkeypatch):
    monkeypatch.delenv("VOLTWALL_TRUST", raising=False)
    url, certificate, asked = pit
    before = len(asked)
    with pytest.raises(urllib.error.URLError) as refused:
        ask(url, trust)
    assert len(asked) == before
    if trust is not None:
        assert certificate.fingerprint.replace(":", "") in str(refused.value)


@pytest.mark.parametrize("trust", ["no-such-file", "AB:CD", "0" * 63])
def test_what_is_neither_is_named(trust):
    with pytest.raises(ConfigError, match=r"trust.*64 hexadecimal"):
        context_for(trust)
