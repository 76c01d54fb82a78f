import pytest
from starlette.responses import PlainTextResponse
from starlette.testclient import TestClient

from app.api.application import SecurityHeaders
from app.api.web.static import find_file


@pytest.fixture
def root(tmp_path):
    (tmp_path / "secret.txt").write_text("secret")
    built = tmp_path / "static"
    (built / "assets").mkdir(parents=True)
    (built / "index.html").write_text("<!doctype html>")
    (built / "assets" / "a.js").write_text("1")
    return built


def test_files_are_found_by_their_names(root):
    assert find_file(root, "assets/a.js").read_text() == "1"
    assert find_file(root, "assets/") is None
    assert find_file(root, "") is None


@pytest.mark.parametrize(
    "path", ["../secret.txt", "assets/../../secret.txt", "/etc/passwd", "a" * 300, "\0", "x/" * 3000, "\ud800", ".."]
)
def test_nothing_else_is(root, path):
    assert find_file(root, path) is None


def test_a_route_of_the_page_gets_the_page_and_an_old_asset_does_not(client):
    page = client.get("/packs/3")
    assert page.status_code in (200, 503)
    assert client.get("/assets/of-an-older-build.js").status_code == 404
    for method, path in (("GET", "/api/v1/nothing"), ("DELETE", "/api/v1/nothing"), ("GET", "/api/v1/config/")):
        nothing = client.request(method, path)
        assert (nothing.status_code, nothing.json()["type"]) == (404, "urn:voltwall:not-found")
        assert path in nothing.json()["detail"]
    assert client.head("/").status_code == page.status_code


def test_every_answer_carries_the_headers_that_keep_others_out(client):
    headers = client.get("/").headers
    assert "frame-ancestors 'none'" in headers["content-security-policy"]
    assert headers["x-content-type-options"] == "nosniff"


def test_data_is_kept_in_no_cache(client):
    assert client.get("/api/v1/health").headers["cache-control"] == "no-store"


@pytest.mark.parametrize(
    ("scheme", "has_name", "told"), [("https", True, True), ("https", False, False), ("http", True, False)]
)
def test_over_https_the_browser_is_told_to_stay_there(scheme, has_name, told):
    app = SecurityHeaders(PlainTextResponse("hello"), has_name=has_name)
    answer = TestClient(app, base_url=f"{scheme}://pit.local").get("/")
    assert ("strict-transport-security" in answer.headers) == told
    assert answer.headers["referrer-policy"] == "same-origin"
