import urllib.error
from collections.abc import Iterator

import pytest

import voltwall
from tests.http_stub import http_stub


@pytest.fixture
def url() -> Iterator[str]:
    elsewhere = {"Location": "http://127.0.0.1:1/elsewhere"}  # nobody: whoever goes there is refused
    with http_stub(lambda _: (302, elsewhere, b"")) as url:
        yield url


def test_the_password_is_not_taken_to_another_server(url):
    with pytest.raises(urllib.error.HTTPError, match=r"sends us on to 127\.0\.0\.1:1"):
        voltwall.connect(url, password="secret").latest()
