"""The documents that describe the interface to other programs: OpenAPI of the routes, AsyncAPI of the live stream."""

import json
import re
from pathlib import Path
from typing import Any

from fastapi import FastAPI

from app import __version__
from app.api.web.authentication import OPEN_PATHS
from app.api.web.problems import MEDIA_TYPE

PREFIX = "/api/v1"
EXAMPLES = Path(__file__).parents[1] / "schemas" / "examples.json"
SCHEMA_REF = "#/components/schemas/"
SECURITY: dict[str, dict[str, str]] = {
    "password": {
        "type": "http",
        "scheme": "basic",
        "description": "any name with a shared password, an account's name and password, or any name and a token",
    },
    "token": {"type": "http", "scheme": "bearer", "description": "a program's token, vw_..."},
    "cookie": {
        "type": "apiKey",
        "in": "cookie",
        "name": "voltwall-8000",
        "description": "what POST login sets: voltwall-PORT, over HTTPS __Host-voltwall-PORT",
    },
}
_VERBS = {
    "acknowledge",
    "control",
    "export",
    "identify",
    "load",
    "login",
    "logout",
    "preview",
    "query",
    "split",
    "stop",
    "store",
    "unplug",
}
_METHODS = {"get": "get", "put": "set", "post": "create", "delete": "delete"}
_NO_PLURAL = frozenset({"bus", "metrics", "series"})
_BY_NAME = {  # where method and path say too little
    ("post", "/sessions"): "start_recording",
    ("post", "/sessions/{session_id}/markers"): "add_marker",
    ("post", "/commands/{name}"): "send_command",
    ("post", "/imports"): "upload_recording",
    ("post", "/imports/{upload_id}"): "start_import",
    ("post", "/setup/batteries"): "upload_battery",
    ("post", "/setup/profile-drafts"): "draft_profile",
    ("post", "/setup/profile-drafts/{draft_id}"): "correct_profile_draft",
    ("post", "/can/dbc"): "import_dbc",
    ("post", "/can/transmit"): "start_transmitting",
    ("delete", "/can/transmit"): "stop_transmitting",
    ("get", "/can/transmit"): "get_transmitting",
    ("post", "/can/transmit/replay"): "replay_can_frames",
    ("delete", "/race-plan"): "end_race_plan",
    ("post", "/driver-can/message"): "send_message_to_driver",
    ("put", "/season/sessions/{session_id}/tags"): "tag_session",
    ("post", "/season/swaps"): "add_swap",
    ("delete", "/season/swaps/{swap_id}"): "remove_swap",
    ("delete", "/tokens/{token_id}"): "revoke_token",
    ("delete", "/logins/{login_id}"): "end_login",
    ("post", "/simulator/faults"): "inject_fault",
    ("delete", "/simulator/faults"): "clear_faults",
    ("delete", "/simulator/faults/{name}"): "clear_fault",
    ("post", "/simulator/speed"): "set_simulator_speed",
    ("post", "/simulator/next"): "begin_next_phase",
    ("post", "/simulator/scenario"): "start_scenario",
    ("post", "/replay"): "start_replay",
    ("post", "/fetch"): "start_fetch",
    ("get", "/fetch"): "get_fetch",
    ("post", "/calibration/current"): "calibrate_current",
    ("post", "/calibration/slave"): "check_slave",
    ("get", "/calibration/slave"): "list_slave_checks",
    ("get", "/sessions/{session_id}/compare/{other_id}"): "compare_sessions",
    ("get", "/config/compare"): "compare_configs",
    ("post", "/config/history/{number}/rollback"): "roll_back_config",
    ("put", "/me/password"): "set_own_password",
    ("post", "/tokens"): "create_token",
    ("get", "/setup/plugged"): "list_plugged_adapters",
    ("post", "/setup/check-link"): "check_setup_link",
    ("put", "/copies/order"): "set_copy_order",
    ("delete", "/sessions/{session_id}/laps"): "forget_session_laps",
}


def operation_id(method: str, path: str) -> str:
    """Return what a person calls an operation: `list_sessions`, `get_session_series`, `stop_session`.

    Args:
        method: in small letters.
        path: with its parameters in braces.
    """
    path = path.removeprefix(PREFIX)
    if (method, path) in _BY_NAME:
        return _BY_NAME[method, path]
    parts = path.strip("/").split("/")
    words = [
        _singular(part) if following.startswith("{") else part
        for part, following in zip(parts, [*parts[1:], ""], strict=True)
        if not part.startswith("{")
    ]
    verb = _METHODS[method]
    if words[-1] in _VERBS:
        verb = words.pop()
    elif method == "get" and not parts[-1].startswith("{") and words[-1] != _singular(words[-1]):
        verb = "list"
    return re.sub(r"\W", "_", "_".join([verb, *words]))


def _singular(word: str) -> str:
    if word in _NO_PLURAL or not word.endswith("s") or word.endswith("ss"):
        return word
    return f"{word[:-2]}" if word.endswith("xes") else f"{word[:-3]}y" if word.endswith("ies") else word[:-1]


def install(app: FastAPI) -> None:
    """Complete the OpenAPI document: names of operations, who may come in, examples, media type of problems.

    Args:
        app: has its routes by the time at which the document is asked for.
    """
    plain = app.openapi

    def openapi() -> dict[str, Any]:
        if app.openapi_schema is None:
            app.openapi_schema = _completed(plain())
        return app.openapi_schema

    app.openapi = openapi  # type: ignore[method-assign]


def _completed(document: dict[str, Any]) -> dict[str, Any]:
    document["servers"] = [{"url": "/", "description": "the service that gives this document"}]
    document["components"]["securitySchemes"] = SECURITY
    _add_examples(document)
    document["security"] = [{}, *({name: []} for name in SECURITY)]  # {}: on loopback without a password
    for route, methods in document["paths"].items():
        for method, operation in methods.items():
            operation["operationId"] = operation_id(method, route)
            problem = operation["responses"]["default"]
            problem["content"] = {MEDIA_TYPE: next(iter(problem["content"].values()))}
            if route in OPEN_PATHS:
                operation["security"] = []
    return document


def _add_examples(document: dict[str, Any]) -> None:
    """Add an example to every schema that has one in `app/api/schemas/examples.json`, by the schema's name."""
    examples = json.loads(EXAMPLES.read_text(encoding="utf-8"))
    schemas = dict(document["components"]["schemas"])
    for methods in document["paths"].values():
        for operation in methods.values():
            for content in operation.get("requestBody", {}).get("content", {}).values():
                schema = content.get("schema", {})
                schemas.setdefault(schema.get("title", ""), schema)  # one that stands at its route
    for name, example in examples.items():
        schemas[name]["examples"] = [example]


def asyncapi(openapi: dict[str, Any]) -> dict[str, Any]:
    """Return the AsyncAPI document of the live stream; a message is the snapshot of the OpenAPI document.

    Args:
        openapi: describes the routes of the same application.
    """
    schemes = {name: dict(scheme) for name, scheme in SECURITY.items()}
    schemes["cookie"]["type"] = "httpApiKey"
    rate = {"type": "number", "exclusiveMinimum": 0, "maximum": 1000, "description": "most messages a second"}
    return {
        "asyncapi": "3.0.0",
        "info": {
            "title": "Voltwall",
            "version": __version__,
            "description": "The live stream of the pit wall: each new snapshot is one text message; a slow reader "
            "misses some. Close codes: 4401 log in, 4403 foreign origin, 4429 too many wrong passwords.",
        },
        "servers": {
            "service": {
                "host": "127.0.0.1:8000",
                "pathname": PREFIX,
                "protocol": "ws",
                "description": "wss where the service has a certificate",
                "security": [{"$ref": f"#/components/securitySchemes/{name}"} for name in schemes],
            }
        },
        "channels": {
            "live": {
                "address": "/live",
                "messages": {"snapshot": {"$ref": "#/components/messages/snapshot"}},
                "bindings": {
                    "ws": {"method": "GET", "query": {"type": "object", "properties": {"rate": rate}}},
                },
            }
        },
        "operations": {
            "send_snapshot": {
                "action": "send",
                "channel": {"$ref": "#/channels/live"},
                "messages": [{"$ref": "#/channels/live/messages/snapshot"}],
            }
        },
        "components": {
            "messages": {
                "snapshot": {"contentType": "application/json", "payload": {"$ref": SCHEMA_REF + "SnapshotOut"}}
            },
            "schemas": _schemas_of("SnapshotOut", openapi["components"]["schemas"]),
            "securitySchemes": schemes,
        },
    }


def _schemas_of(name: str, schemas: dict[str, Any]) -> dict[str, Any]:
    """A schema and all that it names."""
    used: dict[str, Any] = {}
    waiting = [name]
    while waiting:
        node = waiting.pop()
        if node not in used:
            used[node] = schemas[node]
            waiting += re.findall(re.escape(SCHEMA_REF) + r"(\w+)", str(schemas[node]))
    return used
