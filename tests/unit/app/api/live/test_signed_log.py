"""The signed log over HTTP: who did what, and what is shown to whom."""

import pytest

from app.api.access.accounts import Accounts
from app.configuration.history import ConfigHistory

CHIEF, VIEWER = "chief password", "viewer password"


@pytest.fixture
def client(make_client, tmp_path):
    accounts = Accounts(tmp_path)
    accounts.put("cora", "chief", CHIEF)
    accounts.put("vera", "viewer", VIEWER)
    return make_client()


def log_of(client, name, password):
    answer = client.get("/api/v1/signed-log", auth=(name, password)).json()
    assert answer["all_genuine"]
    return [(each["who"], each["action"], each["what"], each["result"]) for each in answer["records"]]


def test_a_command_that_the_master_did_not_get_is_there_under_its_name(client):
    failed = client.post("/api/v1/commands/charge-start", auth=("cora", CHIEF))
    assert failed.status_code >= 400
    who, action, what, result = log_of(client, "vera", VIEWER)[0]
    assert (who, action, what) == ("cora", "command", "charge-start")
    assert result.startswith("failed: ")
    assert client.get("/api/v1/config/history", auth=("vera", VIEWER)).json()["records"] == []


def test_accounts_and_log_ins_are_shown_to_who_manages_them(client):
    client.post("/api/v1/login", json={"name": "vera", "password": VIEWER})
    client.cookies.clear()
    for _ in range(3):
        client.post("/api/v1/login", json={"name": "vera", "password": "guess"})
    client.put(
        "/api/v1/accounts/erik", json={"role": "engineer", "password": "engineer password"}, auth=("cora", CHIEF)
    )
    made = client.post("/api/v1/tokens", json={"name": "robot", "role": "viewer", "days": 1}, auth=("cora", CHIEF))
    assert made.status_code == 200
    assert log_of(client, "vera", VIEWER) == []
    told = log_of(client, "cora", CHIEF)
    assert ("cora", "access", "account erik: engineer, new password", "done") in told
    assert ("cora", "access", "token robot: viewer, 1 days", "done") in told
    assert ("vera", "login", "viewer, from 127.0.0.1", "done") in told
    refused = [result for who, action, _, result in told if action == "login" and result.startswith("refused")]
    assert refused == ["refused: 1 since the record before"]  # the others within the minute wait for the next record
    (event,) = [
        each for each in client.get("/api/v1/events", auth=("vera", VIEWER)).json()["events"]
        if each["code"] == "login-refused"
    ]  # fmt: skip
    assert "vera" in event["message"]["text"]


def test_what_the_driver_is_shown_is_there_under_the_name_of_who_said_it(client):
    chief = ("cora", CHIEF)
    frame = {"id": 0x6A1, "start_byte": 0, "length": 2}
    assert client.put("/api/v1/driver-can", json={"message": frame}, auth=chief).status_code == 200
    client.post("/api/v1/driver-can/message", json={"message": "box"}, auth=chief)
    client.put("/api/v1/race-plan", json={"laps_to_go": 3, "reserve_soc": 0.1}, auth=chief)
    client.delete("/api/v1/race-plan", auth=chief)
    assert log_of(client, *chief)[:4] == [
        ("cora", "transmit", "race plan: none", "done"),
        ("cora", "transmit", "race plan: 3 laps, 10 % at the end", "done"),
        ("cora", "transmit", "driver's message: box", "done"),
        ("cora", "transmit", "driver's display: 0x6a1", "done"),
    ]


def test_a_full_disk_keeps_no_word_from_the_driver(client, monkeypatch):
    client.put("/api/v1/driver-can", json={"message": {"id": 0x6A1, "length": 2}}, auth=("cora", CHIEF))

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(ConfigHistory, "append", full)
    told = client.post("/api/v1/driver-can/message", json={"message": "box"}, auth=("cora", CHIEF))
    assert told.json()["shown"] == "box"


def test_requests_by_a_shared_password_and_trusted_certificates_are_there(make_client):
    fingerprint = "ab" * 32
    client = make_client(password="shared by engineers", trust=fingerprint)
    erik = ("erik", "shared by engineers")
    for _ in range(3):
        client.get("/api/v1/me", auth=erik)
    body = {"url": "https://car.local:8000", "trust": "cd" * 32}
    assert client.post("/api/v1/fetch", json=body, auth=erik).status_code == 202
    told = log_of(client, *erik)
    assert ("voltwall serve", "setup", f"trust {fingerprint} for every service", "done") in told
    assert ("erik", "setup", f"trust {'cd' * 32} for https://car.local:8000", "done") in told
    assert [each[0] for each in told if each[1] == "login"] == ["erik"]


def test_a_changed_account_is_told_to_everybody_who_looks(client):
    chief = ("cora", CHIEF)
    new = {"old": VIEWER, "new": "another viewer password"}
    assert client.put("/api/v1/me/password", json=new, auth=("vera", VIEWER)).status_code == 204
    client.put("/api/v1/accounts/vera", json={"role": "engineer"}, auth=chief)
    client.delete("/api/v1/accounts/vera", auth=chief)
    events = client.get("/api/v1/events", auth=chief).json()["events"]
    told = [(each["who"], each["message"]["text"]) for each in events if each["code"] == "account-changed"]
    assert sorted(told) == [("cora", "user vera changed")] * 2 + [("vera", "user vera changed")]
