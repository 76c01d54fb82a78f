"""The documents for other programs: names that a person would choose, who may come in, the live stream."""

import json
import re
from collections.abc import Iterator
from typing import Any

import pytest

from app.api.application import create_app
from app.api.web.openapi import operation_id
from app.service.settings import Settings

REF = re.compile(r'"\$ref": "#/([^"]+)"')


def references(document: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    """Each reference within a document and what it leads to, None where it leads nowhere."""
    for path in set(REF.findall(json.dumps(document))):
        found: Any = document
        for part in path.split("/"):
            found = found.get(part) if isinstance(found, dict) else None
        yield path, found


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    from starlette.testclient import TestClient

    settings = Settings(data=tmp_path_factory.mktemp("data"), serial="loop://")
    app = create_app(settings, "serial", serial_url=None, can_url=None)
    app.state.parts.service.stop()
    return TestClient(app, base_url="http://127.0.0.1")


@pytest.mark.parametrize(
    ("method", "path", "name"),
    [
        ("get", "/api/v1/sessions", "list_sessions"),
        ("get", "/api/v1/sessions/{session_id}", "get_session"),
        ("get", "/api/v1/sessions/{session_id}/series", "get_session_series"),
        ("post", "/api/v1/sessions/{session_id}/stop", "stop_session"),
        ("get", "/api/v1/batteries", "list_batteries"),
        ("get", "/api/v1/blackboxes/{box_id}", "get_blackbox"),
        ("put", "/api/v1/config", "set_config"),
        ("put", "/api/v1/race-plan", "set_race_plan"),
        ("delete", "/api/v1/config/profiles/{name}", "delete_config_profile"),
        ("get", "/metrics", "get_metrics"),
    ],
)
def test_an_operation_is_named_by_what_it_does(method: str, path: str, name: str) -> None:
    assert operation_id(method, path) == name


def test_every_operation_has_a_name_of_its_own(client) -> None:
    paths = client.get("/api/v1/openapi.json").json()["paths"]
    names = [operation["operationId"] for methods in paths.values() for operation in methods.values()]
    assert len(set(names)) == len(names) > 100
    assert [name for name in names if not re.fullmatch(r"[a-z]+(_[a-z]+)*", name)] == []


def test_it_tells_how_to_come_in_and_where_nobody_needs_to(client) -> None:
    document = client.get("/api/v1/openapi.json").json()
    schemes = document["components"]["securitySchemes"]
    assert {name for each in document["security"] for name in each} == schemes.keys()
    open_paths = {path for path, methods in document["paths"].items() for o in methods.values() if "security" in o}
    assert open_paths == {"/api/v1/health", "/api/v1/login", "/api/v1/me"}
    assert document["servers"][0]["url"] == "/"


@pytest.mark.parametrize("name", ["openapi", "asyncapi"])
def test_every_reference_of_a_document_leads_somewhere(client, name: str) -> None:
    found = dict(references(client.get(f"/api/v1/{name}.json").json()))
    assert found
    assert [path for path, target in found.items() if target is None] == []


def test_the_live_stream_sends_the_snapshot_of_the_rest_interface(client) -> None:
    live = client.get("/api/v1/asyncapi.json").json()
    rest = client.get("/api/v1/openapi.json").json()
    answer = rest["paths"]["/api/v1/snapshot"]["get"]["responses"]["200"]["content"]["application/json"]["schema"]
    assert live["components"]["messages"]["snapshot"]["payload"] == answer
    schemas = live["components"]["schemas"]
    assert schemas == {name: rest["components"]["schemas"][name] for name in schemas}
    (server,) = live["servers"].values()
    (channel,) = live["channels"].values()
    assert server["pathname"] + channel["address"] == "/api/v1/live"
