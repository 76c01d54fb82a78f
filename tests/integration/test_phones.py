"""Access for phones: a listener on the network by HTTPS that is turned on while the service runs."""

import json
import ssl

import httpx
import pytest

from app.api.access.phones import FILE
from tests.service_process import WAIT_S, Service, until

PASSWORD = "a long enough password"
ON, OFF = {"is_on": True}, {"is_on": False}


@pytest.fixture
def service(tmp_path):
    service = Service(tmp_path, []).start()
    yield service
    service.stop()


def log_in(client, name):
    assert client.post("/login", json={"name": name, "password": PASSWORD}).status_code == 200


@pytest.fixture
def chief(service):
    """A client of the first administrator, who is made on the open page."""
    with service.client() as client:
        assert client.put("/accounts/anna", json={"role": "chief", "password": PASSWORD}).status_code == 200
        log_in(client, "anna")
        yield client


def port_of(service):
    return json.loads((service.data / FILE).read_text())["port"]


def phone(service):
    """A client that trusts the certificate, as a phone that has accepted it."""
    context = ssl.create_default_context(cafile=service.data / "tls-certificate.pem")
    return httpx.Client(base_url=f"https://127.0.0.1:{port_of(service)}/api/v1", verify=context, timeout=WAIT_S)


def test_without_a_password_nothing_is_opened(service):
    with service.client() as client:
        body = client.get("/phones").json()
        assert (body["is_on"], body["is_possible"], body["urls"]) == (False, True, [])
        assert [missing["code"] for missing in body["missing"]] == ["phones-need-password"]
        refused = client.put("/phones", json=ON)
        assert refused.status_code == 409
        assert "password" in refused.json()["detail"]
    assert not (service.data / FILE).exists()


def test_an_administrator_opens_it_while_the_service_runs_and_closes_it(service, chief):
    instance = chief.get("/setup").json()["instance"]
    body = chief.put("/phones", json=ON).json()
    assert body["is_on"]
    port = port_of(service)
    assert all(url == f"https://{httpx.URL(url).host}:{port_of(service)}/" for url in body["urls"])
    assert chief.get("/setup").json()["instance"] == instance, "it runs on"
    with phone(service) as client:
        assert client.get("/snapshot").status_code == 401
        assert client.get("/health", headers={"Host": f"192.168.7.7:{port_of(service)}"}).status_code == 200
        answer = client.post("/login", json={"name": "anna", "password": PASSWORD})
        cookie = answer.headers["set-cookie"].lower()
        assert cookie.startswith("__host-voltwall-")
        assert "secure" in cookie
        assert client.get("/snapshot").status_code == 200
        assert client.get("/phones").json()["fingerprint"] == body["fingerprint"]
    assert chief.get("/health", headers={"Host": "192.168.7.7:8000"}).status_code == 403, "this machine's own stays so"
    assert chief.put("/phones", json=OFF).json()["is_on"] is False
    assert not (service.data / FILE).exists()
    with pytest.raises(httpx.ConnectError):
        httpx.get(f"https://127.0.0.1:{port}/", verify=False)


def test_it_stays_open_over_a_restart_and_not_without_a_password(service, chief):
    chief.put("/phones", json=ON)
    port = port_of(service)
    service.stop()
    service.start()

    def answers():
        try:
            with phone(service) as client:
                return client.get("/health").status_code == 200
        except httpx.TransportError:
            return False

    until(answers)
    assert port_of(service) == port
    service.stop()
    (service.data / "accounts.json").unlink()
    service.start()
    with service.client() as client:
        assert client.get("/phones").json()["is_on"] is False


def test_no_one_but_an_administrator_turns_it_on(service, chief):
    for name, role in (("erik", "engineer"), ("vera", "viewer")):
        chief.put(f"/accounts/{name}", json={"role": role, "password": PASSWORD})
        with service.client() as client:
            log_in(client, name)
            assert client.put("/phones", json=ON).status_code == 403
    secret = chief.post("/tokens", json={"name": "ci", "role": "engineer", "days": 1}).json()["secret"]
    with service.client(headers={"Authorization": f"Bearer {secret}"}) as client:
        assert client.put("/phones", json=ON).status_code == 403
    assert not (service.data / FILE).exists()


def test_a_service_whose_accounts_are_removed_lets_nobody_in_from_the_network(service, chief):
    chief.put("/phones", json=ON)
    with phone(service) as client:
        (service.data / "accounts.json").unlink()
        assert client.get("/snapshot").status_code in (401, 403)
