"""The container's health check against a server that says what the service would."""

import json
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

from app.service.health.probe import main


class Answers(BaseHTTPRequestHandler):
    body: bytes = b""

    def do_GET(self) -> None:
        self.send_response(200 if self.path == "/api/v1/health" else 404)
        self.end_headers()
        self.wfile.write(type(self).body)

    def log_message(self, *args) -> None:
        pass


@pytest.fixture
def server() -> Iterator[HTTPServer]:
    server = HTTPServer(("127.0.0.1", 0), Answers)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield server
    server.shutdown()
    server.server_close()
    thread.join()


@pytest.mark.parametrize(
    ("status", "reasons", "code"),
    [("ok", [], 0), ("degraded", ["no broker"], 0), ("failing", ["RS232 silent", "disk full"], 1), (None, [], 1)],
)
def test_it_follows_what_the_service_says(server, status, reasons, code, capsys):
    Answers.body = json.dumps({"status": status, "reasons": reasons}).encode()
    assert main({"VOLTWALL_PORT": str(server.server_port)}) == code
    said = capsys.readouterr().out
    assert all(reason in said for reason in [*reasons, str(status)])


@pytest.mark.parametrize("body", [b"", b"[]", b"<html>"])
def test_another_server_on_the_port_is_not_healthy(server, body):
    Answers.body = body
    assert main({"VOLTWALL_PORT": str(server.server_port)}) == 1


def test_who_does_not_answer_is_not_healthy(server, capsys):
    port = server.server_port
    server.server_close()
    assert main({"VOLTWALL_PORT": str(port)}) == 1
    assert "does not answer" in capsys.readouterr().out
