"""The container's health check against a server that says what the service would."""

import json

import pytest

from app.service.health.probe import main
from tests.http_stub import http_stub


def asked_of(body: bytes) -> int:
    """Return what the check says of a server that answers so."""
    with http_stub(lambda asked: (200 if asked.path == "/api/v1/health" else 404, {}, body)) as url:
        return main({"VOLTWALL_PORT": url.rpartition(":")[2]})


@pytest.mark.parametrize(
    ("status", "reasons", "code"),
    [("ok", [], 0), ("degraded", ["no broker"], 0), ("failing", ["no data on RS232", "disk full"], 1), (None, [], 1)],
)
def test_it_follows_what_the_service_says(status, reasons, code, capsys):
    assert asked_of(json.dumps({"status": status, "reasons": reasons}).encode()) == code
    said = capsys.readouterr().out
    assert all(reason in said for reason in [*reasons, str(status)])


@pytest.mark.parametrize("body", [b"", b"[]", b"<html>"])
def test_another_server_on_the_port_is_not_healthy(body):
    assert asked_of(body) == 1


def test_who_does_not_answer_is_not_healthy(capsys):
    with http_stub(lambda _: (200, {}, b"")) as url:
        port = url.rpartition(":")[2]
    assert main({"VOLTWALL_PORT": port}) == 1
    assert "does not respond" in capsys.readouterr().out
