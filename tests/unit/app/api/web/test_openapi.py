"""The documents for other programs: names that a person would choose, who may come in, the live stream."""

import json
import re
from collections.abc import Iterator
from importlib.resources import files
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


def body_schemas(document: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Each JSON body that is asked for, and its schema."""
    for path, methods in document["paths"].items():
        for method, operation in methods.items():
            for media_type, content in operation.get("requestBody", {}).get("content", {}).items():
                if media_type == "application/json":
                    schema = next(iter(content["schema"].get("anyOf", [content["schema"]])))
                    name = schema.get("$ref", "").rpartition("/")[2]
                    yield f"{method} {path}", document["components"]["schemas"].get(name, schema)


def test_every_body_has_an_example(client) -> None:
    found = list(body_schemas(client.get("/api/v1/openapi.json").json()))
    assert len(found) > 30
    assert [operation for operation, schema in found if not schema.get("examples")] == []


def test_every_example_is_what_its_schema_allows(client) -> None:
    import jsonschema_rs  # what schemathesis judges answers with

    document = client.get("/api/v1/openapi.json").json()
    schemas = document["components"]["schemas"]
    of_bodies = dict(body_schemas(document))
    given = {name: schema for name, schema in [*schemas.items(), *of_bodies.items()] if schema.get("examples")}
    told = json.loads((files("app.api.schemas") / "examples.json").read_text(encoding="utf-8"))
    assert {json.dumps(schema["examples"][0]) for schema in given.values()} == {*map(json.dumps, told.values())}
    for name, schema in given.items():
        judge = jsonschema_rs.validator_for({**schema, "components": document["components"]})
        wrong = [f"{[*error.instance_path]}: {error.message}" for error in judge.iter_errors(schema["examples"][0])]
        assert wrong == [], name


def test_what_an_example_asks_is_taken_by_its_model(client) -> None:
    """Not only by the schema: by what the route itself checks."""
    examples = json.loads((files("app.api.schemas") / "examples.json").read_text(encoding="utf-8"))
    assert client.put("/api/v1/race-plan", json=examples["RacePlanIn"]).status_code == 200
    assert client.put("/api/v1/recorder", json=examples["PlanIn"]).status_code == 200
    assert client.post("/api/v1/login", json=examples["LoginIn"]).status_code == 200
    assert client.post("/api/v1/sessions/nothing/markers", json=examples["NewMarker"]).status_code == 404


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
