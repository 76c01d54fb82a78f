import re
import threading
from base64 import b64encode
from concurrent.futures import ThreadPoolExecutor

import pytest
from starlette.datastructures import Headers
from starlette.websockets import WebSocketDisconnect

from app.api.access.login_attempts import PER_MINUTE
from app.api.web import authentication as auth
from app.api.web.authentication import Authentication, User, is_own_host, is_same_origin
from app.api.web.problems import Problem
from app.errors import ConfigError
from app.service.settings import Settings
from tests.fake_clock import FakeClock

ENGINEER, VIEWER = "correct horse", "battery staple"
LIVE = "ws://127.0.0.1/api/v1/live"
WRITES = [
    ("PUT", "/config"),
    ("PUT", "/can"),
    ("POST", "/config/store"),
    ("POST", "/config/load"),
    ("PUT", "/config/profiles/x"),
    ("POST", "/can/dbc"),
    ("POST", "/can/transmit"),
    ("POST", "/can/transmit/replay"),
    ("DELETE", "/can/transmit"),
    ("DELETE", "/config/profiles/x"),
    ("POST", "/config/history/1/rollback"),
    ("POST", "/commands/clear-faults"),
    ("POST", "/identify"),
    ("POST", "/calibration/current"),
    ("POST", "/calibration/slave"),
    ("POST", "/sessions"),
    ("POST", "/sessions/x/stop"),
    ("POST", "/sessions/x/split"),
    ("PUT", "/sessions/x/laps"),
    ("DELETE", "/sessions/x/laps"),
    ("POST", "/season/query"),
    ("POST", "/season/swaps"),
    ("PUT", "/season/sessions/x/tags"),
    ("DELETE", "/season/swaps/x"),
    ("PUT", "/recorder"),
    ("POST", "/fetch"),
    ("POST", "/imports"),
    ("POST", "/imports/x"),
    ("POST", "/imports/x/preview"),
    ("POST", "/sessions/x/markers"),
    ("DELETE", "/sessions/x"),
    ("POST", "/replay"),
    ("POST", "/replay/control"),
    ("POST", "/replay/stop"),
    ("POST", "/events/1/acknowledge"),
    ("POST", "/alarms/1/acknowledge"),
    ("POST", "/simulator/faults"),
    ("DELETE", "/simulator/faults"),
    ("DELETE", "/simulator/faults/x"),
    ("POST", "/simulator/speed"),
    ("POST", "/simulator/next"),
    ("POST", "/simulator/unplug"),
    ("POST", "/simulator/scenario"),
    ("PUT", "/setup"),
    ("POST", "/setup/check-link"),
    ("POST", "/setup/profile-drafts"),
    ("POST", "/setup/profile-drafts/x"),
    ("POST", "/setup/batteries"),
    ("PUT", "/race-plan"),
    ("DELETE", "/race-plan"),
    ("PUT", "/driver-can"),
    ("POST", "/driver-can/message"),
    ("PUT", "/copies/order"),
    ("PUT", "/phones"),
    ("PUT", "/accounts/x"),
    ("DELETE", "/accounts/x"),
    ("POST", "/tokens"),
    ("DELETE", "/tokens/x"),
]


@pytest.fixture
def clock():
    return FakeClock()


@pytest.fixture
def authentication(tmp_path, clock):
    return Authentication(Settings(data=tmp_path, password=ENGINEER, viewer_password=VIEWER), clock)


@pytest.fixture(scope="module")
def guarded(make_module_client):
    """An application with a password for each role, in which nobody changes anything."""
    return make_module_client(password=ENGINEER, viewer_password=VIEWER)


def basic(password: str) -> Headers:
    return Headers({"authorization": "Basic " + b64encode(f"anna:{password}".encode()).decode()})


def test_each_password_is_a_role(authentication):
    assert authentication.login("anna", ENGINEER, "a") == User("anna", "engineer")
    assert authentication.login("", VIEWER, "a") == User("viewer", "viewer")
    assert authentication.login("anna", "", "a") is None
    assert authentication.login("anna", ENGINEER + " ", "a") is None
    assert authentication.login("anna", "\ud800", "a") is None


def test_guessing_is_stopped_for_a_minute_also_over_basic(authentication, clock):
    for _ in range(PER_MINUTE):
        assert authentication.user_of(basic("wrong"), "10.0.0.1") is None
    with pytest.raises(Problem) as stopped:
        authentication.user_of(basic(ENGINEER), "10.0.0.1")
    assert stopped.value.status == 429
    assert stopped.value.headers["Retry-After"] == "60"
    assert authentication.user_of(basic(ENGINEER), "10.0.0.2").role == "engineer"
    clock.advance(61)
    assert authentication.user_of(basic(ENGINEER), "10.0.0.1").role == "engineer"


def test_a_password_over_basic_is_checked_once_and_a_wrong_one_each_time(authentication):
    right, wrong = basic(VIEWER), basic("wrong")
    for headers in (right, wrong):
        assert authentication.is_slow(headers)
        authentication.user_of(headers, "10.0.0.1")
    assert not authentication.is_slow(right)
    assert authentication.user_of(right, "10.0.0.1") == User("anna", "viewer")
    assert authentication.is_slow(wrong)


def test_logging_in_as_viewer_gives_no_new_tries_at_the_engineers_password(authentication, clock):
    for _ in range(PER_MINUTE):
        assert authentication.login("eve", VIEWER, "10.0.0.9").role == "viewer"
        assert authentication.login("eve", "guess", "10.0.0.9") is None
    with pytest.raises(Problem):
        authentication.login("eve", "guess", "10.0.0.9")


def test_many_viewers_do_not_log_the_engineer_out(authentication, monkeypatch):
    monkeypatch.setattr(auth, "MAX_SESSIONS", 20)
    token = authentication.open_session(User("ada", "engineer"))
    tokens = [authentication.open_session(User("eve", "viewer")) for _ in range(auth.MAX_SESSIONS + 5)]
    asked = [authentication.user_of(Headers({"cookie": f"voltwall={t}"}), "a") for t in (token, tokens[0], tokens[-1])]
    assert asked == [User("ada", "engineer"), None, User("eve", "viewer")]


def test_one_password_for_both_roles_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="every viewer is an engineer"):
        Settings(data=tmp_path, password=ENGINEER, viewer_password=ENGINEER).check()


def test_a_network_of_ipv6_addresses_is_one_guesser(authentication):
    for i in range(PER_MINUTE):
        authentication.login("", "wrong", f"2001:db8::{i:x}")
    with pytest.raises(Problem):
        authentication.login("", ENGINEER, "2001:db8::ffff:1")
    assert authentication.login("", ENGINEER, "2001:db8:0:1::1")


def test_many_guessers_do_not_wash_out_the_one(authentication):
    for _ in range(PER_MINUTE):
        authentication.login("", "wrong", "10.0.0.1")
    for i in range(2000):
        authentication.login("", "wrong", f"10.1.{i // 250}.{i % 250}")
    with pytest.raises(Problem):
        authentication.login("", ENGINEER, "10.0.0.1")


def test_guesses_at_once_count_as_well(authentication):
    tried = []
    gate = threading.Barrier(8)

    def guess(_):
        gate.wait()
        for _ in range(10):
            try:
                tried.append(authentication.login("", "wrong", "10.0.0.1"))
            except Problem:
                return

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(guess, range(8)))
    assert len(tried) == PER_MINUTE


def test_a_session_ends_by_logout_and_after_a_day(authentication, clock):
    tokens = [authentication.open_session(User("anna", "engineer")) for _ in range(2)]

    def who(token):
        return authentication.user_of(Headers({"cookie": f"other=1; voltwall={token}"}), "a")

    assert who(tokens[0]).name == "anna"
    authentication.close_session(tokens[0])
    assert who(tokens[0]) is None
    assert who(tokens[1]) is not None
    for _ in range(24):
        clock.advance(3599)
        assert who(tokens[1]) is not None
    clock.advance(25)
    assert who(tokens[1]) is None
    assert who("") is None


@pytest.mark.parametrize(
    ("headers", "allowed"),
    [
        ({"host": "h:1"}, True),
        ({"host": "h:1", "origin": "http://h:1"}, True),
        ({"host": "h:1", "origin": "http://h:2"}, False),
        ({"host": "h:1", "origin": "http://h"}, False),
        ({"host": "h:1", "origin": "null"}, False),
        ({"host": "h:1", "origin": ""}, False),
        ({"host": "h:1", "origin": "http://h:1.evil"}, False),
        ({"host": "h:1", "origin": "http://["}, False),
        ({"host": "h:1", "sec-fetch-site": "same-origin"}, True),
        ({"host": "h:1", "sec-fetch-site": "cross-site"}, False),
        ({"host": "h:1", "sec-fetch-site": "same-site"}, False),
    ],
)
def test_origins(headers, allowed):
    assert is_same_origin(Headers(headers)) is allowed


@pytest.mark.parametrize(
    ("host", "own"),
    [
        ("127.0.0.1:8000", True),
        ("localhost", True),
        ("[::1]:8000", True),
        ("127.9.9.9", True),
        ("evil.example", False),
        ("localhost.evil.example", False),
        ("10.0.0.1", False),
        ("", False),
        ("[", False),
    ],
)
def test_on_loopback_only_its_own_names_are_answered(host, own):
    assert is_own_host(host, loopback=True) is own


def test_a_foreign_name_is_refused_on_every_path(client):
    for path in ("/", "/api/v1/health", "/metrics"):
        assert client.get(path, headers={"Host": "evil.example"}).status_code == 403


@pytest.mark.parametrize(("method", "path"), WRITES)
def test_every_write_needs_the_engineer(guarded, method, path):
    assert guarded.request(method, "/api/v1" + path).status_code == 401
    response = guarded.request(method, "/api/v1" + path, auth=("bob", VIEWER))
    assert response.status_code == 403
    assert response.json()["type"] == "urn:voltwall:engineer-required"


def test_no_write_was_forgotten(client):
    paths = client.get("/api/v1/openapi.json").json()["paths"]
    found = {(m.upper(), p) for p, methods in paths.items() for m in methods if m.upper() not in ("GET", "HEAD")}
    known = {(m, p.replace("/x", "/{}").replace("/1/", "/{}/").replace("clear-faults", "{}")) for m, p in WRITES}
    open_to_viewers = {("POST", "/login"), ("POST", "/logout"), ("PUT", "/me/password"), ("DELETE", "/logins/{}")}
    assert {(m, re.sub(r"{\w+}", "{}", p).removeprefix("/api/v1")) for m, p in found} == known | open_to_viewers


def test_reading_needs_somebody(make_client):
    client = make_client(password=ENGINEER, viewer_password=VIEWER)
    paths = client.get("/api/v1/openapi.json", auth=("a", VIEWER)).json()["paths"]
    for path in (p for p, methods in paths.items() if "get" in methods and "{" not in p):
        expected = 200 if path in ("/api/v1/health", "/api/v1/me") else 401
        assert client.get(path).status_code == expected, path
    for live in (LIVE, LIVE + "less"):
        with pytest.raises(WebSocketDisconnect) as closed, client.websocket_connect(live) as socket:
            socket.receive_text()
        assert closed.value.code == 4401


def test_a_foreign_origin_gets_no_stream(client):
    with (
        pytest.raises(WebSocketDisconnect) as closed,
        client.websocket_connect(LIVE, headers={"Origin": "http://evil.example"}) as live,
    ):
        live.receive_text()
    assert closed.value.code == 4403


def test_a_session_that_nobody_uses_ends(authentication, clock):
    token = authentication.open_session(User("anna", "engineer"))
    cookie = Headers({"cookie": f"voltwall={token}"})
    clock.advance(59 * 60)
    assert authentication.user_of(cookie, "a").name == "anna"
    clock.advance(60 * 60)
    assert authentication.user_of(cookie, "a") is None


def test_over_https_only_this_very_host_can_set_the_cookie(tmp_path):
    secure = Authentication(Settings(data=tmp_path, tls=True), FakeClock())
    assert secure.cookie_name(Headers({"host": "pit.local:8000"})) == "__Host-voltwall-8000"
    assert secure.token_of(Headers({"host": "pit.local:8000", "cookie": "voltwall-8000=set-by-another"})) is None


def test_the_cookie_of_another_port_of_the_host_is_another(authentication):
    token = authentication.open_session(User("anna", "engineer"))
    here = {"host": "pit.local:8000", "cookie": f"voltwall-8000={token}; voltwall-8100=other"}
    assert authentication.user_of(Headers(here), "a").name == "anna"
    assert authentication.user_of(Headers(here | {"host": "pit.local:8100"}), "a") is None


def test_data_stays_in_no_cache_and_the_page_speaks_to_its_own_service_alone(client):
    headers = client.get("/api/v1/me").headers
    assert headers["cache-control"] == "no-store"
    policy = dict(each.strip().split(" ", 1) for each in headers["content-security-policy"].split(";"))
    assert policy["connect-src"] == "'self'"
