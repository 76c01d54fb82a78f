"""Every value that a route takes, one after the other replaced by hostile ones: nothing is the service's failure."""

import json
import time
from collections.abc import Iterator
from itertools import count
from typing import Any
from urllib.parse import quote

import numpy as np
import pytest

from tests.campaign import campaign, of_size

AT_ONCE_S = 5.0  # for one answer, on a busy machine
MOST_BYTES = 100_000  # bytes of a refusal: no input is repeated in full
NO_CAR = (503, 504)  # no link is configured
LEFT_OUT = (
    "/simulator/balancing",
    "/setup/check-link",
    "/fetch",
    "/logout",
)  # simulate for minutes, or look for devices
UNLIMITED = {  # texts that only the size of a request limits: they are looked up, or matched with If-Match
    "if-match", "session_id", "other_id", "box_id", "draft_id", "name", "body",
}  # fmt: skip
TEXTS = (
    "", "nan", "-inf", "-0", "1e400", str(2**63), str(-(2**63)), "9" * 60_000, "v[" + "9" * 60_000 + "]",
    "v[99999999999999999]", "estimate.soc[999999999]", "²", "٣", "\0", "a/b", "..", "v" + "[0]" * 3000, "\ud800",
)  # fmt: skip
VALUES = (
    "null", "NaN", "-Infinity", "1e400", "-0", "1.5", str(2**63), str(-(2**63) - 1), "1" * 60_000, "0." + "1" * 60_000,
    "1e" + "9" * 60_000, '"\\ud800"', '"\\u0000"', '"²"', f'"{"x" * 100_000}"', "[" * 100_000 + "]" * 100_000,
    '{"a":' * 100_000 + "1" + "}" * 100_000, "[" * 100 + "]" * 100, "[null]", '{"":{}}', '{"a":1,"a":2}', "999999999",
    f"[{'1,' * 100_000}1]", "{" + ",".join(f'"x{k}":1' for k in range(60_000)) + "}",
)  # fmt: skip
TURNS = of_size(6, 3, 1)
HERE = "\x01"  # in the place of the value that is replaced


@pytest.fixture
def session_id(make_session):
    time_s = np.arange(0.0, 100.0, 0.5)
    return make_session(time_s, 80 + 40 * np.sin(time_s), 3.7, 25, 0.8).stem


@pytest.fixture
def document(client) -> dict[str, Any]:
    found: dict[str, Any] = client.app.openapi()
    return found


def routes(document: dict[str, Any]) -> Iterator[tuple[str, str, dict[str, Any]]]:
    for path, methods in sorted(document["paths"].items()):
        if not path.endswith(LEFT_OUT):
            yield from ((method, path, route) for method, route in methods.items())


def resolved(document: dict[str, Any], schema: dict[str, Any]) -> dict[str, Any]:
    """A schema itself, where it is named; of several the first."""
    while several := schema.get("anyOf") or schema.get("oneOf") or ("$ref" in schema and [schema]):
        schema = several[0]
        if "$ref" in schema:
            schema = document["components"]["schemas"][schema["$ref"].rpartition("/")[2]]
    return schema


def example(document: dict[str, Any], schema: dict[str, Any]) -> Any:
    """A value of a schema."""
    schema = resolved(document, schema)
    if "const" in schema or "enum" in schema:
        return schema.get("const", schema.get("enum", [None])[0])
    match schema.get("type"):
        case "object":
            more = schema.get("additionalProperties")
            known = {name: example(document, each) for name, each in schema.get("properties", {}).items()}
            return known | ({"a": example(document, more)} if isinstance(more, dict) else {})
        case "array":
            inner = schema.get("items") or schema["prefixItems"][0]
            return [example(document, inner)] * max(1, schema.get("minItems", 1))
        case "integer" | "number":
            return schema.get("minimum", 1)
        case "boolean":
            return False
    return "x" * schema.get("minLength", 1)


def places(value: Any) -> Iterator[Any]:
    """The value with HERE in the place of itself, and of each part of it."""
    yield HERE
    if isinstance(value, dict):
        yield from ({**value, name: inner} for name in value for inner in places(value[name]))
    elif isinstance(value, list):
        yield from ([inner, *value[1:]] for inner in places(value[0]))


def share(values: tuple[str, ...], turn: int) -> tuple[str, ...]:
    """The values of a turn: all in the full campaign, else some, others in the next turn."""
    return values[turn % TURNS :: TURNS]


def refused_or_answered(client, method: str, path: str, **sent: Any) -> None:
    began = time.monotonic()
    answer = client.request(method, path, **sent)
    took_s = time.monotonic() - began
    what = f"{method} {path[:120]} {str(sent)[:200]}: {answer.status_code} in {took_s:.1f} s, {answer.text[:200]}"
    assert answer.status_code < 500 or answer.status_code in NO_CAR, what
    assert took_s < AT_ONCE_S, what
    if answer.status_code >= 400:
        assert json.loads(answer.content)["status"] == answer.status_code, what
        assert len(answer.content) < MOST_BYTES, what


def address(document, path: str, route: dict[str, Any], session_id: str, name: str = "", text: str = "") -> str:
    """The address of a route, with a text in the place of one of its parameters."""
    query = []
    for each in route.get("parameters", []):
        valid = session_id if each["name"] in ("session_id", "other_id") else example(document, each["schema"])
        valid = valid[0] if isinstance(valid, list) else valid
        value = quote((text if each["name"] == name else str(valid)).encode("utf-8", "surrogatepass"), safe="")
        if each["in"] == "path":
            path = path.replace(f"{{{each['name']}}}", value)
        elif each["in"] == "query" and (each["name"] == name or each.get("required")):
            query.append(f"{each['name']}={value}")
    return f"{path}?{'&'.join(query)}"


def json_body(route: dict[str, Any]) -> dict[str, Any] | None:
    schema: dict[str, Any] | None = (
        route.get("requestBody", {}).get("content", {}).get("application/json", {}).get("schema")
    )
    return schema


@campaign(120, 300, 600)
def test_a_hostile_parameter_is_refused_or_answered(client, document, session_id):
    turn = count()
    for method, path, route in routes(document):
        schema = json_body(route)
        sent = {"headers": {"If-Match": "*"}} | ({} if schema is None else {"json": example(document, schema)})
        for each in route.get("parameters", []):
            for text in share(TEXTS, next(turn)) if each["in"] in ("path", "query") else ():
                where = address(document, path, route, session_id, each["name"], text)
                refused_or_answered(client, method, where, **sent)


@campaign(120, 300, 600)
def test_a_hostile_body_is_refused_or_answered(client, document, session_id):
    headers = {"If-Match": "*", "Content-Type": "application/json"}
    turn = count()
    for method, path, route in routes(document):
        schema = json_body(route)
        for place in () if schema is None else places(example(document, schema)):
            whole = json.dumps(place)
            for value in share(VALUES, next(turn)):
                body = whole.replace(json.dumps(HERE), value)
                where = address(document, path, route, session_id)
                refused_or_answered(client, method, where, content=body, headers=headers)


def unlimited(document: dict[str, Any], schema: dict[str, Any], name: str) -> Iterator[str]:
    """Names of the texts, lists and tables of a schema that have no limit."""
    if "$ref" in schema:
        schema = resolved(document, schema)
    for each in (*schema.get("anyOf", ()), *schema.get("oneOf", ())):
        yield from unlimited(document, each, name)
    kind = schema.get("type")
    if kind == "string" and not {"maxLength", "pattern", "enum", "const", "format"} & set(schema):
        yield name
    more = schema.get("additionalProperties")
    if (kind == "array" and "maxItems" not in schema) or (kind == "object" and more and "maxProperties" not in schema):
        yield name
    inner = [schema.get("items"), *schema.get("prefixItems", ()), more]
    for each in inner:
        if isinstance(each, dict):
            yield from unlimited(document, each, f"{name}[]")
    for key, each in schema.get("properties", {}).items():
        yield from unlimited(document, each, f"{name}.{key}")


def test_every_text_list_and_table_of_a_request_has_a_limit(document):
    found = set()
    for method, path, route in routes(document):
        schemas = [(each["name"], each["schema"]) for each in route.get("parameters", [])]
        schemas += [("body", each["schema"]) for each in route.get("requestBody", {}).get("content", {}).values()]
        for name, schema in schemas:
            found |= {(method, path, each) for each in unlimited(document, schema, name) if each not in UNLIMITED}
    assert not found


@pytest.mark.parametrize("signal", ["v[" + "9" * 60_000 + "]", "v[999999999]", "v[²]", "v" + "[0]" * 3000, "v[0]x"])
@pytest.mark.parametrize("what", ["series", "export"])
def test_a_signal_that_is_none_names_the_parameter(client, session_id, signal, what):
    answer = client.get(f"/api/v1/sessions/{session_id}/{what}", params={"signal": signal})
    assert answer.status_code == 422
    assert answer.json()["errors"][0]["field"].startswith("signal")


@pytest.mark.parametrize("length", ["9" * 60_000, "9" * 16])
def test_a_length_of_any_digits_is_too_large(client, length):
    assert client.post("/api/v1/login", content=b"{}", headers={"Content-Length": length}).status_code == 413


def test_a_body_of_many_wrong_members_names_the_limit(client):
    answer = client.post("/api/v1/commands/set-soc", json={f"x{k}": 1 for k in range(60_000)})
    assert answer.status_code == 422
    assert "60000 members; at most" in answer.json()["detail"]


@pytest.mark.parametrize(
    "line",
    [
        "BO_ {} M: 8 A\n SG_ Cell_1 : 0|16@1+",
        "BO_ 1 M: {} A\n SG_ Cell_1 : 0|16@1+",
        "BO_ 1 M: 8 A\n SG_ Cell_{} : 0|16@1+",
        "BO_ 1 M{}: 8 A\n SG_ Cell_1 : 0|16@1+",
    ],
)
def test_a_dbc_with_numbers_of_many_digits_is_refused(client, line):
    files = {"a.dbc": 'VERSION ""\nBU_: A\n' + line.format("9" * 5000) + ' (1,0) [0|1] "V" A\n'}
    answer = client.post("/api/v1/setup/profile-drafts", json={"files": files})
    assert answer.status_code == 422
    assert "a.dbc" in answer.json()["detail"]


def test_a_signal_that_begins_at_a_number_of_many_digits_is_left_out_and_named(client):
    signal = "Cell_1 : " + "9" * 5000 + '|16@1+ (1,0) [0|1] "V" A'
    answer = client.post("/api/v1/setup/profile-drafts", json={"files": {"a.dbc": f"BO_ 1 M: 8 A\n SG_ {signal}\n"}})
    assert answer.status_code == 200
    assert any("Cell_1" in check["what"]["text"] for check in answer.json()["checks"])
