"""Whatever is sent, the answer is a problem document that says what was wrong; nothing is the service's failure."""

import json

import pytest
from starlette.websockets import WebSocketDisconnect

from app.api.web.middleware import MAX_BODY_BYTES
from app.words import message_from_json, render

JSON = {"Content-Type": "application/json"}
EDIT = JSON | {"If-Match": "*"}
PREFIX = "/api/v1"


@pytest.fixture(scope="module")
def client(make_module_client):
    """One application for the whole file: nothing that is sent here is taken."""
    return make_module_client()


def refused(response, *statuses: int) -> dict:
    assert response.status_code in statuses, response.text
    assert response.headers["content-type"] == "application/problem+json"
    return json.loads(response.content, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))


@pytest.mark.parametrize(
    "number", ["NaN", "Infinity", "-Infinity", "1e999", '"\\ud800"', '"x"', "2", "[1]", "9" * 4000]
)
def test_an_argument_that_is_no_share_names_the_field(client, number):
    body = refused(client.post(f"{PREFIX}/commands/set-soc", content=f'{{"argument": {number}}}', headers=JSON), 422)
    assert body["errors"][0]["field"] == "argument"


@pytest.mark.parametrize(
    "text", ["[" * 100_000, "", "null", "{", '{"argument": ' + "9" * 5000 + "}", b"\xff\xfe", '{"argument"', "\ud7ff"]
)
def test_a_body_that_is_no_object_of_ours(client, text):
    refused(client.post(f"{PREFIX}/commands/set-soc", content=text, headers=JSON), 400, 422)


@pytest.mark.parametrize(
    ("path", "body", "field"),
    [
        ("/commands/fan-override", {"argument": 0.5, "duration": 3}, "duration"),
        ("/commands/set-soc", {"argument": True}, "argument"),
        ("/commands/can-tx-enable", {"argument": True}, "argument"),
        ("/sessions", {"nam": "race"}, "nam"),
        ("/replay/control", {"zz": 1}, "zz"),
        ("/sessions/x/markers", None, "body"),
    ],
)
def test_what_is_misspelt_or_of_another_kind_is_not_guessed_at(client, path, body, field):
    answer = refused(client.post(PREFIX + path, json=body), 422)
    assert answer["errors"][0]["field"] == field
    assert answer["errors"][0]["limit"]


def test_a_stretch_to_loop_is_a_list_of_two(client):
    refused(
        client.post(f"{PREFIX}/replay/control", json={"loop": [1, 2.5]}), 409
    )  # understood, but nothing is replayed
    refused(client.post(f"{PREFIX}/replay/control", json={"loop": [1]}), 422)


@pytest.mark.parametrize("query", ["series?signal=v[0]&from=5&to=2", "export?from=5&to=2"])
def test_a_range_that_ends_before_it_begins(client, query):
    assert refused(client.get(f"{PREFIX}/sessions/x/{query}"), 422)["errors"][0]["field"] == "to"


@pytest.mark.parametrize("what", ["stop", "split", "markers"])
def test_a_session_that_is_not_there(client, what):
    refused(client.post(f"{PREFIX}/sessions/zz/{what}", json={"text": "x"}), 404)


@pytest.mark.parametrize("path", ["/health", "/snapshot", "/config/schema", "/nothing", "/commands/reset"])
def test_head_answers_as_get(client, path):
    before, head, after = (client.request(method, PREFIX + path).status_code for method in ("GET", "HEAD", "GET"))
    assert head in (before, after)  # the first snapshot may come meanwhile


def test_a_fraction_is_no_index(client):
    refused(client.post(f"{PREFIX}/commands/can-send", json={"argument": 0.4}), 422)


@pytest.mark.parametrize(
    ("method", "path"),
    [
        ("POST", f"/events/{10**30}/acknowledge"),
        ("POST", f"/alarms/{10**30}/acknowledge"),
        ("GET", f"/events?after={10**30}"),
        ("GET", "/history?seconds=nan"),
        ("GET", "/sessions/none/series?signal=v[0]&from=nan"),
        ("GET", "/sessions/none/series?signal=v[0]&from=-inf"),
        ("GET", "/sessions/none/export?to=1e300"),
        ("POST", "/replay"),
    ],
)
def test_numbers_out_of_every_range(client, method, path):
    refused(client.request(method, PREFIX + path), 422)


@pytest.mark.parametrize("body", ['{"seek_s": NaN}', '{"speed": Infinity}', '{"seek_s": -1}'])
def test_a_replay_is_not_moved_to_nowhere(client, body):
    refused(client.post(f"{PREFIX}/replay/control", content=body, headers=JSON), 422)


@pytest.mark.parametrize("session", ["../../events", "..%2f..%2fevents", "a" * 400, "%00", "..", "C:x", "%ff"])
def test_a_session_id_reaches_no_other_file(client, session):
    refused(client.get(f"{PREFIX}/sessions/{session}/file"), 404)


@pytest.mark.parametrize(
    ("name", "value"), [("Host", "["), ("Host", "[::1"), ("Host", ""), ("Origin", "http://["), ("Origin", "null")]
)
def test_headers_that_are_no_url(client, name, value):
    refused(client.get(f"{PREFIX}/snapshot", headers={name: value}), 403)


@pytest.mark.parametrize("cookie", ["a,b=c", "=", ";;;", "voltwall=\u00e9; @x=1", "voltwall=" + "x" * 4000])
def test_a_cookie_that_is_none_is_nobody(make_client, cookie):
    client = make_client(password="correct horse")
    refused(client.get(f"{PREFIX}/events", headers={"Cookie": cookie.encode("latin-1")}), 401)


@pytest.mark.parametrize("name", ["Content-Length", None])
def test_a_huge_body_is_refused_before_it_fills_the_memory(client, name):
    part = b"x" * (1 << 19)
    content = part * 4 if name else (part for _ in range(4))
    refused(client.put(f"{PREFIX}/config", content=content, headers=EDIT), 413)


@pytest.mark.parametrize(("method", "path", "allowed"), [("DELETE", "/snapshot", "GET"), ("GET", "/race-plan", "PUT")])
def test_a_wrong_method_says_which_ones_there_are(client, method, path, allowed):
    response = client.request(method, PREFIX + path)
    assert refused(response, 405)["type"] == "urn:voltwall:method-not-allowed"
    assert allowed in response.headers["allow"]


@pytest.mark.parametrize("rate", ["nan", "-1", "0", "1e9", "x"])
def test_a_rate_that_is_none_closes_the_stream(client, rate):
    def listen() -> None:
        with client.websocket_connect(f"ws://127.0.0.1{PREFIX}/live?rate={rate}") as live:
            while True:
                live.receive_text()

    with pytest.raises(WebSocketDisconnect) as closed:
        listen()
    assert closed.value.code == 1008


def test_a_field_is_given_in_one_way(client):
    body = {"values": {"telemetry_period": 110}, "raw": {"telemetry_period": 120}}
    assert (
        refused(client.put(f"{PREFIX}/config", json=body, headers=EDIT), 422)["errors"][0]["field"]
        == "telemetry_period"
    )


@pytest.mark.parametrize(
    ("method", "path", "sent", "english", "norwegian"),
    [
        ("GET", "/nothing", {}, "no route /api/v1/nothing", "finnes ikke: rute /api/v1/nothing"),
        ("DELETE", "/health", {}, "Method not allowed", "Metoden er ikke tillatt"),
        ("POST", "/can/transmit", {"json": {}}, "frames: required", "frames: kreves"),
        (
            "GET",
            "/can/trace?limit=0",
            {},
            "limit: must be at least 1",
            "limit: må være minst 1",
        ),
        (
            "GET",
            "/can/trace?limit=2001",
            {},
            "limit: must be at most 2000",
            "limit: må være høyst 2000",
        ),
        (
            "GET",
            "/calibration/slave?pack=8",
            {},
            "pack: must be below 8",
            "pack: må være under 8",
        ),
        (
            "POST",
            "/replay/control",
            {"json": {"loop": [1]}},
            "loop.tuple[float, float].1: required; loop.literal['off']: must be one of off",
            "loop.tuple[float, float].1: kreves; loop.literal['off']: må være en av off",
        ),
        (
            "GET",
            "/history?seconds=0",
            {},
            "seconds: must be above 0",
            "seconds: må være over 0",
        ),
        (
            "POST",
            "/commands/reset",
            {"json": {"argument": 1}},
            "argument = 1.0: this command takes no arguments",
            "argument = 1.0: denne kommandoen tar ingen argumenter",
        ),
        (
            "POST",
            "/commands/set-soc",
            {"content": (b" " * 1000 for _ in range(MAX_BODY_BYTES // 1000 + 1))},
            f"maximum request size {MAX_BODY_BYTES} bytes",
            f"høyeste størrelse på en forespørsel er {MAX_BODY_BYTES} byte",
        ),
    ],
)
def test_what_is_refused_is_told_in_english_and_by_code(client, method, path, sent, english, norwegian):
    body = refused(client.request(method, PREFIX + path, **sent), 404, 405, 413, 422)
    told = message_from_json(body["message"])
    assert (body["detail"], render(told), render(told, language="nb")) == (english, english, norwegian)


@pytest.mark.parametrize(("method", "path"), [("POST", "/logout"), ("GET", "/me"), ("GET", "/sessions")])
def test_a_query_that_is_no_utf8_is_no_failure(client, method, path):
    statuses: list[int] = []

    async def receive():
        return {"type": "http.request", "body": b"", "more_body": False}

    async def send(message):
        statuses.append(message.get("status", 0))

    scope = {
        "type": "http",
        "method": method,
        "path": PREFIX + path,
        "query_string": b"\xff=\xfe",
    }  # as no client sends it
    headers = [(b"host", b"127.0.0.1")]
    scope |= {"scheme": "http", "headers": headers, "client": ("127.0.0.1", 1), "server": ("127.0.0.1", 80)}
    client.portal.call(client.app, scope, receive, send)
    assert 200 <= statuses[0] < 500
