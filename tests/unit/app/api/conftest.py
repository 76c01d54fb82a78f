"""The application in this process, on a data folder of its own, with no link configured."""

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from app.api.application import create_app
from app.service import wiring
from app.service.settings import Settings
from tests.in_process import InProcess

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # it asks for another HTTP client than ours
    from starlette.testclient import TestClient

ENGINEER, VIEWER = "correct horse", "battery staple"


@contextmanager
def clients(folder: Path) -> Iterator[Callable[..., TestClient]]:
    """Start applications; what they raise comes out as 500, as it would for a browser."""
    open_clients: list[TestClient] = []

    def make(**settings) -> TestClient:
        app = create_app(
            Settings(**{"data": folder, "record": False, "season": False} | settings),
            "serial",
            serial_url=None,
            can_url=None,
        )
        client = TestClient(app, base_url="http://127.0.0.1", raise_server_exceptions=False, client=("127.0.0.1", 1))
        open_clients.append(client.__enter__())
        return client

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(wiring, "Workers", InProcess)
        yield make
        for client in open_clients:
            client.__exit__(None, None, None)


@pytest.fixture
def make_client(tmp_path: Path) -> Iterator[Callable[..., TestClient]]:
    """Start applications for one test."""
    with clients(tmp_path) as make:
        yield make


@pytest.fixture(scope="module")
def make_module_client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., TestClient]]:
    """Start applications for all tests of a module, which change nothing in them."""
    with clients(tmp_path_factory.mktemp("application")) as make:
        yield make


@pytest.fixture
def client(make_client) -> TestClient:
    return make_client()
