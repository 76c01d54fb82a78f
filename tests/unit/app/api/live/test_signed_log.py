"""The signed log over HTTP: who did what, and what is shown to whom."""

import pytest

from app.api.access.accounts import Accounts

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
    assert "vera" in event["text"]
