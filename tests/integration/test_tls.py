"""HTTPS of the real service: its own certificate, clients that know it by fingerprint, what comes in without TLS."""

import hashlib
import re
import socket
import ssl
from pathlib import Path

import httpx
import pytest
from websockets.exceptions import WebSocketException

import voltwall
from app.commands.tls import certificate_of
from app.service.settings import Settings
from tests.service_process import WAIT_S, until

PASSWORD = "correct horse"


@pytest.fixture(scope="module")
def pit(make_module_service):
    return make_module_service("--tls", VOLTWALL_PASSWORD=PASSWORD)


@pytest.fixture(scope="module")
def fingerprint(pit):
    until(lambda: any("SHA-256" in line for line in pit.lines))
    return re.search(r"SHA-256 ([0-9A-F:]{95})$", "\n".join(pit.lines), re.MULTILINE)[1]


def trusting(pit) -> ssl.SSLContext:
    return ssl.create_default_context(cafile=pit.data / "tls-certificate.pem")


def test_the_printed_fingerprint_is_that_of_what_is_served(pit, fingerprint):
    address = httpx.URL(pit.base_url)
    pem = ssl.get_server_certificate((address.host, address.port))
    shown = hashlib.sha256(ssl.PEM_cert_to_DER_cert(pem)).hexdigest().upper()
    assert fingerprint.replace(":", "") == shown
    with pit.client(verify=trusting(pit), auth=("anna", PASSWORD)) as client:
        assert client.get("/system").json()["certificate"]["fingerprint"] == fingerprint


def test_the_cookie_goes_by_https_alone(pit):
    with pit.client(verify=trusting(pit)) as client:
        cookie = client.post("/login", json={"name": "anna", "password": PASSWORD}).headers["set-cookie"].lower()
        assert "secure" in cookie
        assert cookie.startswith("__host-voltwall-")
        assert "path=/" in cookie
        assert client.get("/me").json()["name"] == "anna"
        assert client.get("/me").json()["role"] == "engineer"


def test_a_stranger_of_the_system_is_not_believed(pit):
    with pit.client() as client, pytest.raises(httpx.ConnectError, match="CERTIFICATE_VERIFY_FAILED"):
        client.get("/health")


def test_python_reads_the_live_battery_by_fingerprint(pit, fingerprint):
    live = voltwall.connect(pit.base_url, password=PASSWORD, trust=fingerprint)
    with live as snapshots:
        for _, snapshot in zip(range(20), snapshots, strict=False):
            assert "cells" in snapshot
    assert "cells" in live.latest()
    with pytest.raises((OSError, WebSocketException)), voltwall.connect(pit.base_url, trust="0" * 64):
        pass


def test_commands_reach_it_by_fingerprint_or_file(pit, fingerprint, voltwall, tmp_path):
    asked = ("config", "history", "--url", pit.base_url, "--trust")
    assert voltwall(*asked, fingerprint, VOLTWALL_PASSWORD=PASSWORD).returncode == 0
    assert voltwall(*asked, str(pit.data / "tls-certificate.pem"), VOLTWALL_PASSWORD=PASSWORD).returncode == 0
    refused = voltwall(*asked, "0" * 64, VOLTWALL_PASSWORD=PASSWORD)
    assert refused.returncode == 3
    assert "untrusted certificate" in refused.stderr
    fetch = ("sessions", "fetch", pit.base_url, "--data", str(tmp_path), "--trust")
    assert voltwall(*fetch, fingerprint, VOLTWALL_REMOTE_PASSWORD=PASSWORD).returncode == 0


def test_without_tls_and_with_an_old_one_nothing_is_answered(pit):
    address = httpx.URL(pit.base_url)
    with pytest.raises(httpx.HTTPError):
        httpx.get(f"http://{address.host}:{address.port}/api/v1/health", timeout=WAIT_S)
    old = ssl.create_default_context()
    old.check_hostname, old.verify_mode = False, ssl.CERT_NONE
    old.maximum_version = ssl.TLSVersion.TLSv1_2
    old.minimum_version = ssl.TLSVersion.TLSv1_2
    with socket.create_connection((address.host, address.port)) as plain, old.wrap_socket(plain) as secured:
        assert secured.version() == "TLSv1.2"


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("--host", "0.0.0.0"), "--tls.*--plain-http"),
        (("--tls", "--plain-http"), "one of --tls"),
        (("--tls-cert", "x.pem"), "tls_key"),
        (("--tls-cert", "x.pem", "--tls-key", "y.pem"), "x.pem"),
    ],
)
def test_what_cannot_be_served_is_one_line(voltwall, tmp_path, words, named):
    result = voltwall("serve", "--data", str(tmp_path), *words, VOLTWALL_PASSWORD=PASSWORD)
    assert result.returncode == 2
    assert len(result.stderr.splitlines()) == 1
    assert re.search(named, result.stderr)


def test_a_certificate_of_the_users_with_another_key_is_named(voltwall, tmp_path):
    paths = [certificate_of(Settings(data=made(tmp_path / name), tls=True)) for name in "ab"]
    files = ("--tls-cert", str(paths[0].certificate), "--tls-key", str(paths[1].key))
    result = voltwall("serve", "--port", "0", "--data", str(tmp_path), *files)
    assert result.returncode == 2
    assert "must be the unencrypted PEM key" in result.stderr


def made(folder: Path) -> Path:
    folder.mkdir()
    return folder
