"""Every request that writes a file, on a file system that is really full: 507, and all is as before."""

import json
import sys
from pathlib import Path

import pytest

from tests.integration.test_small_disk import on_small_disk

SCRIPT = """
import contextlib, json, os, sys, warnings
from pathlib import Path

from app.api.application import create_app
from app.service.settings import Settings
from app.sources.connections import Connections, Setup
from tests.in_process import InProcess
from tests.unit.app.sessions.conftest import recorder_in

warnings.simplefilter("ignore")
from starlette.testclient import TestClient

PASSWORD = "correct horse battery"
disk = Path(os.environ["DISK"])
data = disk / "data"
recorder = recorder_in(data / "sessions")
session = recorder.start("run").id
recorder.close()
setup = Setup(data, Connections(), fixed=False)
setup.on_choice = lambda: None
app = create_app(Settings(data=data, record=False, season=False), "serial", serial_url=None, can_url=None, setup=setup)
battery = Path("app/battery/bundled/foxbms-2.toml").read_text()
REQUESTS = {
    "PUT /accounts/bob": {"role": "viewer", "password": PASSWORD},
    "DELETE /accounts/eva": None,
    "POST /tokens": {"name": "script", "role": "viewer", "days": 1},
    "PUT /setup": {"battery": "foxbms-2"},
    "POST /setup/batteries": {"files": {"mine.toml": battery + "\\n# " + "x" * 9000, "extra.txt": "new"}},
    "POST /imports?filename=a.csv": b"t,I,v1\\n" + b"1,2,3.7\\n" * 5000,
    "PUT /recorder": {"event": "FSG", "driver": "x" * 50},
    "PUT /config/profiles/wet": {"source": "default"},
    "POST /season/swaps": {"cells": [3], "note": "x" * 500},
    f"PUT /season/sessions/{session}/tags": {"tags": {"track": "x" * 200}},
    f"PUT /sessions/{session}/laps": {
        "laps": [{"start_s": 10.0 * k, "end_s": 10.0 * k + 9, "note": "x" * 200} for k in range(100)]
    },
    "PUT /me/password": {"old": PASSWORD, "new": "another horse battery"},
}


def send(client, request):
    method, path = request.split(" ")
    body = REQUESTS[request]
    given = {"content": body} if isinstance(body, bytes) else {} if body is None else {"json": body}
    return client.request(method, "/api/v1" + path, **given)


def state():
    left_out = ("-wal", "-shm", ".lock", ".jsonl", "events.sqlite", ".index.json")
    return {
        str(path.relative_to(data)): path.read_bytes().hex()
        for path in sorted(data.rglob("*"))
        if path.is_file() and not path.name.endswith(left_out) and "imports" not in path.parts
    }


with TestClient(app, base_url="http://127.0.0.1", raise_server_exceptions=False, client=("127.0.0.1", 1)) as client:
    must = lambda answer: answer.status_code < 300 or sys.exit(f"{answer.status_code} {answer.text}")
    must(client.put("/api/v1/accounts/ada", json={"role": "chief", "password": PASSWORD}))
    must(client.post("/api/v1/login", json={"name": "ada", "password": PASSWORD}))
    must(client.put("/api/v1/accounts/eva", json={"role": "viewer", "password": PASSWORD}))
    must(client.put("/api/v1/config/profiles/dry", json={"source": "default"}))
    must(client.put("/api/v1/config/profiles/wet", json={"source": "default"}))
    must(client.post("/api/v1/setup/batteries", json={"files": {"mine.toml": battery, "extra.txt": "old"}}))
    app.state.parts.service.events.store.flush()
    with (disk / "ballast").open("wb", buffering=0) as ballast:
        with contextlib.suppress(OSError):
            while True:
                ballast.write(bytes(4096))
    before = state()
    for request in REQUESTS:
        answer = send(client, request)
        print(json.dumps({"request": request.replace(session, "ID"), "status": answer.status_code,
            "type": answer.json().get("type"), "detail": answer.json().get("detail"), "same": state() == before}))
    (disk / "ballast").unlink()
    for request in REQUESTS:
        answer = send(client, request)
        print(json.dumps({"again": request, "status": answer.status_code, "text": answer.text[:200]}))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="needs Linux namespaces")
def test_every_request_that_writes_answers_507_and_changes_nothing(tmp_path: Path) -> None:
    lines = on_small_disk(tmp_path, f'"$PYTHON" -W ignore - <<"END"\n{SCRIPT}\nEND')
    found = [json.loads(line) for line in lines]
    refused = [each for each in found if "request" in each]
    assert len(refused) >= 12
    for each in refused:
        assert (each["status"], each["type"]) == (507, "urn:voltwall:storage"), each
        assert each["same"], each
    again = [each for each in found if "again" in each]
    assert all(each["status"] < 300 for each in again), again
