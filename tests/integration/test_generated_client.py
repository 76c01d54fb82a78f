"""A Python client that openapi-python-client makes of the OpenAPI document works against a running service."""

import importlib
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.campaign import SIZE

pytest.importorskip("openapi_python_client", reason="openapi-python-client is not installed")
pytestmark = [
    pytest.mark.timeout(400),  # the generator writes 500 files
    pytest.mark.skipif(SIZE == "sample", reason="half a minute: make campaign"),
]
PASSWORD = "three words of ours"


@pytest.fixture
def call(make_service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Any]:
    """Call an operation of the client, made from the document that the service gives; as a person who logged in."""
    service = make_service("--seed", "1", "--no-record", VOLTWALL_PASSWORD=PASSWORD)
    made = tmp_path / "generated_client"
    with service.client(auth=("Anna", PASSWORD)) as plain:
        (tmp_path / "openapi.json").write_bytes(plain.get("/openapi.json").content)
    command = [sys.executable, "-m", "openapi_python_client", "generate", "--meta", "none"]
    command += ["--path", str(tmp_path / "openapi.json"), "--output-path", str(made)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    told = [line for line in done.stdout.splitlines() if line.startswith("WARNING parsing")]
    assert [line for line in told if "will not be generated" in line and "/can/dbc" not in line] == []
    monkeypatch.syspath_prepend(str(tmp_path))
    client = importlib.import_module(f"{made.name}.client").Client(base_url=service.base_url, timeout=60)

    def call(operation: str, *arguments: str, body: tuple[str, dict[str, Any]] | None = None, **asked: Any) -> Any:
        module = importlib.import_module(f"{made.name}.api.{operation}")
        if body is not None:
            asked["body"] = getattr(importlib.import_module(f"{made.name}.models"), body[0]).from_dict(body[1])
        answer = module.sync(*arguments, client=client, **asked)
        assert type(answer).__name__ != "ProblemOut", answer
        return answer

    yield call
    client.get_httpx_client().close()


def test_it_logs_in_marks_a_lap_lists_by_pages_and_reads_a_snapshot(call) -> None:
    assert call("login.login", body=("LoginIn", {"name": "Anna", "password": PASSWORD})).role == "engineer"
    assert call("login.get_me").name == "Anna"
    for name in ("first", "second", "third"):
        recording = call("sessions.start_recording", body=("NewSession", {"name": name}))
        if name != "third":  # one without a frame or a mark would not be kept
            call("sessions.add_marker", recording.id, body=("NewMarker", {"text": "", "kind": "note"}))
            assert call("sessions.stop_session", recording.id).stopped is True
    listed = call("sessions.list_sessions")
    assert (len(listed.sessions), listed.next_cursor) == (3, None)
    first = call("sessions.list_sessions", limit=2)
    assert [each.id for each in first.sessions] == [each.id for each in listed.sessions[:2]]
    rest = call("sessions.list_sessions", limit=2, cursor=first.next_cursor)
    assert [each.id for each in rest.sessions] == [each.id for each in listed.sessions[2:]]
    assert [each.recording for each in listed.sessions if each.id == recording.id] == [True]
    assert call("sessions.add_marker", recording.id, body=("NewMarker", {"text": "", "kind": "lap"})).marked is True
    (marker,) = call("sessions.list_session_markers", recording.id).markers
    assert (marker.kind, marker.who) == ("lap", "Anna")
    snapshot = call("live.get_snapshot")
    assert len(snapshot.cells.voltage_v) == 96
