"""Who may do what, and what refuses to start."""

import socket
from collections import deque

import httpx
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from tests.service_process import WAIT_S

READS_ONLY = True

ENGINEER, VIEWER = "correct horse", "battery staple"


@pytest.fixture
def serve(voltwall):
    return lambda *words, **environment: voltwall("serve", *words, **environment)


def test_beyond_loopback_it_refuses_to_start_without_a_password(serve, tmp_path):
    result = serve("--host", "0.0.0.0", "--data", str(tmp_path))
    assert result.returncode == 2
    assert "VOLTWALL_PASSWORD" in result.stderr
    assert len(result.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--port", "70000"), "port"),
        (("--port", "many"), "port"),
        (("--can", "socketcan"), "INTERFACE:CHANNEL"),
        (("--data", "/proc/nothing"), "data"),
        (("--cell", "no-such-cell"), "no-such-cell"),
        (("--scenario", "no-such-scenario"), "no-such-scenario"),
    ],
)
def test_a_wrong_setting_is_one_line_that_names_it(serve, arguments, words, tmp_path):
    data = () if "--data" in arguments else ("--data", str(tmp_path))
    result = serve("--port", "0", *data, *arguments)
    assert result.returncode != 0
    assert words in result.stderr
    assert "Traceback" not in result.stderr


def test_a_short_password_is_refused(serve, tmp_path):
    result = serve("--data", str(tmp_path), VOLTWALL_PASSWORD="abc")
    assert result.returncode == 2
    assert "8 characters" in result.stderr
    assert "abc" not in result.stderr


def test_a_port_in_use_is_named(serve, tmp_path):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        result = serve("--port", str(taken.getsockname()[1]), "--data", str(tmp_path))
    assert result.returncode == 2
    assert "in use" in result.stderr


def test_a_data_folder_in_use_is_named(serve, service):
    result = serve("--port", "0", "--data", str(service.data))
    assert result.returncode == 2
    assert "another voltwall" in result.stderr


@pytest.fixture(scope="module")
def guarded(make_module_service):
    return make_module_service(VOLTWALL_PASSWORD=ENGINEER, VOLTWALL_VIEWER_PASSWORD=VIEWER)


def test_with_a_password_nothing_is_read_without_it(guarded):
    with guarded.client() as client:
        assert client.get("/snapshot").status_code == 401
        assert client.get("/me").json() == {"role": None, "name": None, "password_required": True, "has_chief": False}
        assert client.get("/health").status_code == 200
    assert httpx.get(guarded.base_url + "/metrics", timeout=WAIT_S).status_code == 401
    with (
        connect(guarded.base_url.replace("http", "ws") + "/api/v1/live") as live,
        pytest.raises(Exception, match="4401"),
    ):
        live.recv(timeout=5)


def test_a_viewer_reads_and_may_not_write(guarded):
    with guarded.client(auth=("bob", VIEWER)) as client:
        assert client.get("/me").json()["role"] == "viewer"
        assert client.get("/snapshot").status_code in (200, 503)
        assert client.post("/commands/clear-faults").status_code == 403
        assert client.put("/config", json={}, headers={"If-Match": '"x"'}).status_code == 403


def test_the_engineer_logs_in_with_a_cookie_that_scripts_cannot_read(guarded):
    with guarded.client() as client:
        answer = client.post("/login", json={"name": "anna", "password": ENGINEER})
        assert answer.json()["role"] == "engineer"
        cookie = answer.headers["set-cookie"].lower()
        assert "httponly" in cookie
        assert "samesite=strict" in cookie
        assert client.get("/me").json()["name"] == "anna"
        assert client.post("/sessions/none/stop").status_code == 404
        client.post("/logout")
        assert client.get("/snapshot").status_code == 401


def test_a_stream_ends_when_its_reader_logs_out(guarded):
    with guarded.client() as client:
        client.post("/login", json={"name": "anna", "password": ENGINEER})
        cookie = "; ".join(f"{name}={value}" for name, value in client.cookies.items())
        url = guarded.base_url.replace("http", "ws") + "/api/v1/live"
        with connect(url, additional_headers={"Cookie": cookie}, max_size=1 << 22) as live:
            live.recv(timeout=WAIT_S)
            client.post("/logout")
            with pytest.raises(ConnectionClosed) as closed:
                deque(live, maxlen=0)
    assert closed.value.rcvd.code == 4401


def test_a_wrong_password_is_refused_and_guessing_is_stopped(guarded):
    with guarded.client() as client:
        codes = [client.post("/login", json={"password": f"guess {i}"}).status_code for i in range(12)]
    assert codes[0] == 401
    assert codes[-1] == 429
