"""Every kind of answer of a service has its exit code: read off a real one on loopback that answers as told."""

import argparse
import json
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from app.commands.config import add_arguments, run


@pytest.fixture
def answering():
    """Start a service that gives one answer to everything but reading; returns its address."""
    servers = []

    def start(status, kind):
        problem = json.dumps({"type": f"urn:voltwall:{kind}", "detail": f"this is {kind}", "in_force": "old"}).encode()

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self):
                self.answer(200, bytes(420))

            def do_PUT(self):
                self.rfile.read(int(self.headers["Content-Length"]))
                self.answer(status, problem)

            def do_POST(self):
                self.do_PUT()

            def answer(self, code, body):
                self.send_response(code)
                self.send_header("ETag", '"0123456789abcdef"')
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, *_):
                pass

        server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        servers.append(server)
        return f"http://127.0.0.1:{server.server_port}"

    yield start
    for server in servers:
        server.shutdown()
        server.server_close()


@pytest.mark.parametrize(
    ("status", "kind", "exit_code"),
    [
        (422, "invalid", 2),
        (422, "reason-required", 2),
        (409, "at-work", 2),
        (409, "refused", 2),
        (404, "not-found", 2),
        (503, "link-lost", 3),
        (504, "no-reply", 3),
        (401, "login", 3),
        (403, "forbidden", 3),
        (429, "too-many", 3),
        (412, "changed-meanwhile", 4),
        (504, "not-verified", 5),
    ],
)
def test_an_answer_has_its_exit_code(answering, capsys, status, kind, exit_code):

    parser = argparse.ArgumentParser()
    add_arguments(parser)
    for action in (["write", "ts=50"], ["store"], ["load"]):
        assert run(parser.parse_args(["--url", answering(status, kind), *action])) == exit_code
        said = capsys.readouterr()
        assert said.out == ""
        assert f"this is {kind}" in said.err
    assert f"{exit_code} " in parser.epilog, "the help names it"
