"""`voltwall config`: the master's configuration through a running service, for scripts."""

import argparse
import base64
import json
import os
import sys
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

from app.errors import AppError, ConfigError

OCTETS = "application/octet-stream"
JSON = "application/json"


class ServiceRefused(AppError):
    """The service answered with a problem document."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Actions and where the service is."""
    parser.add_argument("--url", default="http://127.0.0.1:8000", help="the running service (default: %(default)s)")
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    read = actions.add_parser("read", help="print what is in force as JSON in units, or save the 420-byte image")
    read.add_argument("--out", type=Path, metavar="FILE", help="save to FILE: .json as JSON, anything else as image")
    diff = actions.add_parser("diff", help="what a file, or field=value, would change; exit code 1 if anything")
    write = actions.add_parser("write", help="check, write, read back byte for byte")
    for action in (diff, write):
        action.add_argument("edits", nargs="+", metavar="FILE|FIELD=VALUE", help="an image, a JSON file, or ts=50")
    write.add_argument("--store", action="store_true", help="then store in the EEPROM and read it back")
    actions.add_parser("store", help="store what is in force in the EEPROM and read it back")
    parser.epilog = "Where the service wants a password: VOLTWALL_PASSWORD in the environment."


def run(args: argparse.Namespace) -> int:
    """Exit codes: 0 done, 1 diff found changes, 2 refused or not reachable."""
    service = _Service(args.url)
    match args.action:
        case "read":
            return _read(service, args.out)
        case "diff":
            changes = _write(service, args.edits, dry_run=True)["difference"]
            _print_changes(changes)
            return 1 if changes else 0
        case "write":
            answer = _write(service, args.edits, dry_run=False)
            _print_changes(answer["difference"])
            print(f"in force: {answer['hash']}" + (", read back and equal" if answer["verified"] else ", unchanged"))
            return _store(service) if args.store else 0
    return _store(service)


class _Service:
    def __init__(self, url: str) -> None:
        self._base = url.rstrip("/") + "/api/v1/config"

    def ask(
        self, path: str = "", *, method: str = "GET", body: bytes | None = None, headers: dict[str, str] | None = None
    ) -> tuple[bytes, str]:
        """Return (body, etag).

        Raises:
            ServiceRefused: with the problem's own words.
            ConfigError: nobody answers at the URL.
        """
        request = urllib.request.Request(self._base + path, data=body, method=method, headers=headers or {})
        if password := os.environ.get("VOLTWALL_PASSWORD"):
            token = base64.b64encode(f"{os.environ.get('USER', 'script')}:{password}".encode()).decode()
            request.add_header("Authorization", f"Basic {token}")
        try:
            with urllib.request.urlopen(request, timeout=15) as answer:
                return answer.read(), answer.headers.get("ETag", "").strip('"')
        except urllib.error.HTTPError as error:
            raise ServiceRefused(_problem(error.read()) or str(error)) from error
        except (urllib.error.URLError, ValueError, OSError) as error:
            reason = getattr(error, "reason", error)
            raise ConfigError("url", self._base, f"no voltwall service answers there ({reason})") from error


def _problem(body: bytes) -> str:
    try:
        return str(json.loads(body)["detail"])
    except (ValueError, KeyError, TypeError):
        return ""


def _read(service: _Service, out: Path | None) -> int:
    wants_json = out is None or out.suffix == ".json"
    body, etag = service.ask(headers={"Accept": JSON if wants_json else OCTETS})
    if wants_json:
        body = (json.dumps(json.loads(body)["values"], indent=2) + "\n").encode()
    if out is None:
        sys.stdout.write(body.decode())
    else:
        out.write_bytes(body)
        print(f"{out}: {etag}")
    return 0


def _write(service: _Service, edits: list[str], *, dry_run: bool) -> dict[str, Any]:
    _, etag = service.ask(headers={"Accept": OCTETS})
    kind, body = _body_of(edits)
    headers = {"If-Match": f'"{etag}"', "Content-Type": kind}
    query = "?dry_run=true" if dry_run else ""
    answer, _ = service.ask(query, method="PUT", body=body, headers=headers)
    result: dict[str, Any] = json.loads(answer)
    return result


def _body_of(edits: list[str]) -> tuple[str, bytes]:
    values: dict[str, Any] = {}
    for edit in edits:
        name, equals, text = edit.partition("=")
        if equals:
            values[name] = _value(name, text)
            continue
        try:
            content = Path(edit).read_bytes()
        except OSError as error:
            raise ConfigError("file", edit, error.strerror or str(error)) from error
        if Path(edit).suffix != ".json":
            if len(edits) > 1:
                raise ConfigError("edits", edit, "an image stands alone")
            return OCTETS, content
        try:
            values |= json.loads(content)
        except ValueError as error:
            raise ConfigError("file", edit, f"not JSON: {error}") from error
    return JSON, json.dumps({"values": values}).encode()


def _value(name: str, text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError as error:
        raise ConfigError(name, text, "a number, or a JSON list") from error


def _store(service: _Service) -> int:
    answer = json.loads(service.ask("/store", method="POST")[0])
    print(f"stored: {answer['stored_hash']}, read back and equal (counter {answer['counter']})")
    return 0


def _print_changes(changes: list[dict[str, Any]]) -> None:
    for change in changes:
        element = "" if change["element"] is None else f"[{change['element']}]"
        print(f"{change['field']}{element}: {change['from']} -> {change['to']} {change['unit']}".rstrip())
