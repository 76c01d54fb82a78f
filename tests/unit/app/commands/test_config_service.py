"""Every kind of answer of a service has its exit code: read off a real one on loopback that answers as told."""

import json
from contextlib import contextmanager

import pytest

from app.cli import build_parser, main
from tests.http_stub import http_stub


@contextmanager
def answering(status, kind):
    """A service that gives one answer to everything but reading; gives its address."""
    problem = json.dumps({"type": f"urn:voltwall:{kind}", "detail": f"this is {kind}", "in_force": "old"}).encode()
    etag = {"ETag": '"0123456789abcdef"'}
    with http_stub(lambda asked: (200, etag, bytes(420)) if asked.method == "GET" else (status, etag, problem)) as url:
        yield url


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
def test_an_answer_has_its_exit_code(capsys, status, kind, exit_code):
    with answering(status, kind) as url:
        for action in (["write", "telemetry_period=50"], ["store"], ["load"]):
            assert main(["config", "--url", url, *action]) == exit_code
        said = capsys.readouterr()
        assert said.out == ""
        assert f"this is {kind}" in said.err
    help_text = build_parser("config")._subparsers._group_actions[0].choices["config"].epilog
    assert f"{exit_code} " in help_text, "the help names it"
